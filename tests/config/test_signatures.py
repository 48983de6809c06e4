"""What a class of one's own takes is asked of the class itself."""

from __future__ import annotations

import sys

import pytest
import yaml

from expertaug.config import load as config
from expertaug.config import signatures, stage_settings
from shipped import PENDULUM, default, refusals

OWN = """
from torch import nn
from expertaug.models.encoders.window import WindowEncoder
from expertaug.learning.objectives import Aphynity


class Inherits(WindowEncoder):
    pass


class Anything(WindowEncoder):
    def __init__(self, system, times, **options):
        super().__init__(system, times, {"theta": [0.0, 5.0]})


class Typed(nn.Module):
    def __init__(self, system, times, width: int, share: float = 0.5, name: str | None = None, flag: bool = False):
        super().__init__()

    def forward(self, observed):
        return observed[0]

class Prior(Aphynity):
    def __init__(self, seeds, choices, prior, weight: float = 1.0, **carried):
        super().__init__(seeds, choices, **carried)
"""


ALONE = {"experiments": {"pendulum": {"augmented": [], "augmentations": {"narrow": None, "wide": None}}}}


@pytest.fixture(scope="module")
def base() -> dict:
    return config.merge(default(), {"run": ["pendulum"]})


@pytest.fixture
def own(tmp_path, monkeypatch):
    (tmp_path / "own_classes.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "own_classes", raising=False)


def encoder(kind: str, options: str = "") -> str:
    return PENDULUM.format(f"methods: [aphynity], model: {{encoder: {{kind: 'own_classes:{kind}'{options}}}}}")


def test_what_own_classes_take_is_asked_of_them(own, base):
    for text in (
        encoder("Inherits", ", windows: {theta: [0.0, 5.0]}, latent: 3"),
        encoder("Anything", ", whatever: 3"),
        encoder("Typed", ", width: 3, share: 1, name: null"),
    ):
        config.validate(config.merge(base, config.merge(yaml.safe_load(text), ALONE)))


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("Typed", "encoder.width: missing; Typed needs it"),
        ("Typed|, width: a", "encoder.width: found 'a'; give a whole number"),
        ("Typed|, width: 1e3", "encoder.width: found '1e3', which YAML takes for a text"),
        ("Typed|, width: 3, share: true", "encoder.share: found true; give a number"),
        ("Typed|, width: 3, name: 4", "encoder.name: found 4; give a text or null"),
        ("Typed|, width: 3, wdth: 4", "encoder.wdth: unknown key; did you mean 'width'?"),
        ("Typed|, width: 3, times: 4", "encoder.times: given by the package"),
        ("Inherits|, windows: {}, ltent: 4", "encoder.ltent: unknown key; did you mean 'latent'?"),
        ("None", "no class 'None' in own_classes"),
    ],
)
def test_what_own_classes_do_not_take_is_refused(own, base, options, expected):
    text = config.merge(yaml.safe_load(encoder(*options.split("|"))), ALONE)
    assert expected in refusals(base, yaml.safe_dump(text))[0]


def test_an_own_module_that_fails_is_one_line(own, base, tmp_path):
    (tmp_path / "broken_module.py").write_text("1 / 0\n")
    text = PENDULUM.format("model: {encoder: {kind: 'broken_module:X'}}")
    found = refusals(base, text)
    assert len(found) == 1 and "broken_module cannot be imported (ZeroDivisionError: division by zero)" in found[0]


def test_an_own_objective_gets_p_plus_where_it_names_it(own, base):
    text = "methods: {mine: {kind: hybrid, label: Mine, objective: 'own_classes:Prior'}}"
    over = {"experiments": {"pendulum": {"methods": ["mine"], "training": {"objective": {"weight": 2.0}}}}}
    merged = config.merge(config.merge(base, yaml.safe_load(text)), config.merge(over, ALONE))
    settings = stage_settings.train(config.validate(merged), "pendulum", "mine", "seeds_0_1_2")
    assert settings["prior"] == {"omega0": [0.5, 3.5]} and settings["training"]["objective"]["weight"] == 2.0


class Own:
    """A class whose constructor takes what the package gives, and more."""

    def __init__(self, system, times, width: int, share: float | None = 0.5, *, name="x"):
        self.names = (system, times, width, share, name)


class Anything(Own):
    def __init__(self, **options):
        super().__init__(**options)


def test_a_constructor_says_what_a_configuration_may_give_it():
    assert signatures.takes(Own, "times") and not signatures.accepts(Own, "encoder", "times")
    assert signatures.accepts(Own, "encoder", "name") and not signatures.accepts(Own, "encoder", "nme")
    assert signatures.accepts(Anything, "encoder", "nme")
    assert signatures.is_set_by_constructor(Own, "names") and not signatures.is_set_by_constructor(Own, "label")


def test_every_wrong_option_is_told():
    given = {"times": 1, "share": "a", "nme": 2}
    assert [str(error) for error in signatures.wrong_options(Own, "encoder", given, "e")] == [
        "e.times: given by the package; remove it",
        "e.share: found 'a'; give a number or null",
        "e.nme: unknown key; did you mean 'name'? known: width, share, name",
        "e.width: missing; Own needs it",
    ]
    assert not list(signatures.wrong_options(Own, "encoder", {"width": 3, "share": 1}, "e"))
