"""Hues of methods: the same in every configuration, and two to the colour-blind as well."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from expertaug import plotting
from expertaug.config import report_parameters
from expertaug.config.load import complete_configuration, load
from expertaug.hues import EQUATION, FLOOR, HUES, OWN

# Machado, Oliveira and Fernandes (2009), of deuteranopia, for linear RGB.
DEUTERANOPIA = [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]]
TO_XYZ = [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.072175], [0.0193339, 0.119192, 0.9503041]]
WHITE = [0.95047, 1.0, 1.08883]
DEFAULT = "config/config.yaml"


def seen(colour, matrix):
    """CIELAB of a colour that a matrix takes to what is seen of it."""
    value = np.array(to_rgb(colour))
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    x, y, z = (TO_XYZ @ np.clip(matrix @ linear, 0, 1)) / WHITE
    x, y, z = (np.cbrt(v) if v > 216 / 24389 else (24389 / 27 * v + 16) / 116 for v in (x, y, z))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("matrix", [np.eye(3), np.array(DEUTERANOPIA)], ids=["normal", "deuteranopia"])
@pytest.mark.parametrize("end", ["", "+"])
def test_colours_of_two_hues_differ(matrix, end):
    names = {f"m{k}": k for k in range(len(HUES))}
    colours = [*plotting.colours([name + end for name in names], names).values(), to_rgb(EQUATION)]
    for one, other in itertools.combinations(colours, 2):
        assert np.linalg.norm(seen(one, matrix) - seen(other, matrix)) >= 12


def test_a_method_has_one_hue_in_every_configuration():
    default = complete_configuration(load([DEFAULT]))
    names = [name for name in default.methods if "@" not in name]
    assert set(OWN) == set(names)
    for files in ([DEFAULT], [DEFAULT, "config/data_curves.yaml"], [DEFAULT, "config/peers.yaml"]):
        config = complete_configuration(load(files))
        hues = dict(report_parameters.hues(config))
        assert {name: hues[name] for name in names} == OWN
        for name in config.run:
            own = [hues[method] for method in config.experiments[name].methods if "@" not in method]
            assert len(set(own)) == len(own), name


def test_the_true_equation_looks_like_nothing_else():
    colours = plotting.colours(["truth", "aphynity", "aphynity+"], OWN)
    assert plotting.look("truth", colours) == {"color": EQUATION, "linestyle": ":", "marker": ""}
    assert plotting.look("aphynity", colours)["linestyle"] != ":" and OWN["truth"] == FLOOR
