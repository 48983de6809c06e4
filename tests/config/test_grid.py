"""Each point of a grid becomes a method of its own, which differs from its method in the point's values alone."""

from __future__ import annotations

import itertools

import pytest

from expertaug.config import grid
from expertaug.config import load as config
from expertaug.errors import InputError
from shipped import alone, valid

KEYS = {"training.learning_rate": [0.1, 0.2], "choices.resample": ["once", "epoch"]}


def expanded(keys, method="aphynity"):
    """The pendulum's configuration with a grid, and the changes that were completed for its points."""
    base = config.merge(alone("pendulum"), {"experiments": {"pendulum": {"studies": {"grid": None}}}})
    study = {"experiments": {"pendulum": {"studies": {"grid": {"method": method, "keys": keys}}}}}
    base, changes = config.merge(base, study), []

    def complete(change):
        changes.append(change["experiments"]["pendulum"])
        return valid(config.merge(base, change))

    return grid.expand(valid(base), complete), changes


def test_there_is_a_method_for_every_combination():
    found, changes = expanded(KEYS)
    points = list(itertools.product(*KEYS.values()))
    assert changes == [
        {"overrides": {"aphynity": {"training": {"learning_rate": rate}}}, "choices": {"resample": resample}}
        for rate, resample in points
    ]
    for number, (rate, resample) in enumerate(points, 1):
        name = f"aphynity@{number}"
        own = found.experiment_of("pendulum", name)
        assert found.methods[name].label == f"APHYNITY @{number}"
        assert (own.training.learning_rate, own.choices.resample) == (rate, resample)
        assert own.training.epochs == found.experiment_of("pendulum", "aphynity").training.epochs
    assert "aphynity@1" not in found.experiments["pendulum"].methods, "no table compares the points with the methods"


@pytest.mark.parametrize(
    ("keys", "method", "expected"),
    [
        ({"data.noise": [0.1]}, "aphynity", r"grid\.keys\.data\.noise: cannot be varied"),
        ({"training": [1]}, "aphynity", r"grid\.keys\.training: cannot be varied; a dotted path below model, training"),
        (KEYS, "mean", r"grid\.method: 'mean' is not trained; name a hybrid method"),
        (KEYS, "aphinity", r"grid\.method: 'aphinity' is no method of this experiment; did you mean 'aphynity'"),
    ],
)
def test_what_cannot_be_varied_is_told_before_any_point_is_completed(keys, method, expected):
    with pytest.raises(InputError, match=expected):
        expanded(keys, method)
