"""Options of the classes that a configuration names: the package's own are typed, others are asked themselves."""

from __future__ import annotations

import inspect
import sys
from pathlib import Path

import pytest
import yaml

from expertaug import registry, systems
from expertaug.config import load as config
from expertaug.config import stage_settings
from expertaug.errors import InputError, lines
from expertaug.learning.settings import ALL_PARTS, OBJECTIVES
from expertaug.models.settings import ENCODERS, INTERACTIONS
from expertaug.settings import is_left_out
from expertaug.systems.settings import SYSTEMS

KINDS = {"encoder": ENCODERS, "interaction": INTERACTIONS, "objective": OBJECTIVES}
GIVEN = {"system", "times", "latent", "seeds", "choices", "prior", "functions"}  # not by a configuration
ALONE = {"experiments": {"pendulum": {"augmented": [], "augmentations": {"narrow": None, "wide": None}}}}
PENDULUM = "experiments: {{pendulum: {{{0}}}}}"


@pytest.fixture(scope="module")
def base() -> dict:
    found = config.load([Path(__file__).parents[2] / "config" / "config.yaml"])
    return config.merge(found, {"run": ["pendulum"]})


def refused(base: dict, text: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        config.validate(config.merge(base, yaml.safe_load(text)))
    return lines(caught.value)


@pytest.mark.parametrize(
    ("over", "expected"),
    [
        ("model: {encoder: {activation: zzz}}", "encoder.activation: found 'zzz'; known: relu, silu, selu, tanh"),
        ("model: {encoder: {layers: '16'}}", "encoder.layers: found '16'; give a list"),
        ("model: {encoder: {layers: []}}", "encoder.layers: found []; give 1 or more values"),
        ("model: {encoder: {layers: [-1]}}", "encoder.layers[0]: found -1; give 1 or more"),
        ("model: {encoder: {layers: [1000000000000]}}", "encoder.layers[0]: found 1000000000000; give 65536 or less"),
        ("model: {encoder: {latent: a}}", "encoder.latent: found 'a'; give a whole number"),
        ("model: {encoder: {skip: 1}}", "encoder.skip: found 1; give true or false"),
        ("model: {encoder: {windows: {omega: ['~', 5]}}}", "windows.omega[0]: found '~'; give a number"),
        ("model: {encoder: {windows: {omega: [0, 9]}}}", "windows.omega: found [0.0, 9.0] s; choose within"),
        ("model: {encoder: {windows: {omga: [0, 1]}}}", "'omga' is no component of the state; did you mean 'omega'?"),
        ("model: {encoder: {angles: [x]}}", "encoder.angles[0]: 'x' is no component of the state"),
        ("model: {encoder: {kind: window}, interaction: {components: [x]}}", "interaction.components[0]: 'x' is no"),
        ("model: {encoder: {kind: conv}}", "encoder.kind: 'conv' is for states that are fields"),
        ("model: {encoder: {kind: 'os:system'}}", "encoder.kind: 'system' is no class"),
        ("model: {encoder: {kind: 'os; x:y'}}", "encoder.kind: no module 'os; x'"),
        ("training: {objective: {every: 0}}", "training.objective.every: found 0; give 1 or more"),
        ("training: {objective: {tau2: x}}", "training.objective.tau2: found 'x'; give a number"),
        ("training: {objective: {lambda0: -1}}", "training.objective.lambda0: found -1; give 0 or more"),
        ("training: {objective: {lambda0: [1, -2]}}", "training.objective.lambda0[1]: found -2; give 0 or more"),
        ("system: {name: os.path}", "system.name: os.path defines no System"),
        ("system: {name: 3}", "system.name: found 3"),
        ("system: {name: [pendulum]}", 'system.name: found ["pendulum"]; give name'),
        ("system: {name: null}", "system.name: missing; give name"),
        (
            "data: {start: {omga: [0, 1]}}",
            "data.start.omga: 'omga' is no component of the state",
        ),
        (
            "overrides: {aphynity: {refinement: {windows: {omga: [0, 1]}}}}",
            "overrides.aphynity.refinement.windows.omga: 'omga' is no component of the state",
        ),
        ("system: {name: pendulum, mass: 3}", "system.mass: unknown key"),
    ],
)
def test_a_wrong_option_is_one_line_before_any_job(base, over, expected):
    found = refused(base, PENDULUM.format(over))
    assert len(found) == 1 and expected in found[0]
    assert found[0].startswith("experiments.pendulum.")


@pytest.mark.parametrize(
    ("over", "expected"),
    [
        ("rlc: {system: {equations: x}}", "rlc.system.equations: found 'x'; known: kirchhoff, additive, code"),
        ("reaction_diffusion: {system: {reaction: true}}", "system.reaction: found true; known: false, without_k"),
        ("pendulum: {model: {interaction: {kind: conv}}}", "interaction.kind: 'conv' is for states that are fields"),
        ("reaction_diffusion: {model: {interaction: {kernels: [0]}}}", "kernels[0]: found 0; give 1 or more"),
        ("double_pendulum: {data: {source: simulation}}", "system.name: 'double_pendulum' has no simulation"),
    ],
)
def test_other_systems_are_checked_in_the_same_way(base, over, expected):
    name = over.partition(":")[0]
    data = "data: {step_s: 0.1, t2_s: 1.0, sets: {train: &s {size: 1, z_e: {}}, validation: *s, test: *s}}"
    more = yaml.safe_load(f"run: [{name}]\nexperiments: {{{name}: {{{data if 'simulation' in over else ''}}}}}")
    text = yaml.safe_dump(config.merge(more, yaml.safe_load(f"experiments: {{{over}}}")))
    assert expected in refused(base, text)[0]


@pytest.mark.parametrize("part", KINDS)
def test_options_are_the_arguments_of_the_classes_with_their_defaults(part):
    for name, settings in KINDS[part].items():
        arguments = inspect.signature(registry.find(ALL_PARTS[part], name, part)).parameters
        fields = {n: f for n, f in settings.model_fields.items() if n != "kind"}
        assert set(fields) == set(arguments) - GIVEN | ({"latent"} if "latent" in fields else set()), name
        for option, field in fields.items():
            if not field.is_required() and not is_left_out(settings, option):
                default = arguments[option].default
                assert field.get_default(call_default_factory=True) == default, (name, option)


@pytest.mark.parametrize("name", SYSTEMS)
def test_systems_are_described_as_they_are(name):
    described = SYSTEMS[name]
    arguments = {"expert": "point_mass"} if name == "double_pendulum" else {}
    made = systems.load({"name": name} | arguments)
    parameters = inspect.signature(type(made)).parameters
    assert set(described.model_fields) - {"name"} == set(parameters)
    for option, field in described.model_fields.items():
        assert option == "name" or field.default == parameters[option].default
    for names, attribute in (("STATE", "state"), ("EXPERT", "expert_parameters")):
        assert [p.name for p in getattr(made, attribute)] == list(getattr(described, names))
    assert [p.name for p in made.interaction_parameters] == list(described.INTERACTION)
    assert (len(made.state_shape) > 1) == described.FIELDS
    assert (type(made).truth is not systems.System.truth) == described.SIMULATED


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
    assert expected in refused(base, yaml.safe_dump(text))[0]


def test_an_own_module_that_fails_is_one_line(own, base, tmp_path):
    (tmp_path / "broken_module.py").write_text("1 / 0\n")
    text = PENDULUM.format("model: {encoder: {kind: 'broken_module:X'}}")
    found = refused(base, text)
    assert len(found) == 1 and "broken_module cannot be imported (ZeroDivisionError: division by zero)" in found[0]


def test_an_own_objective_gets_p_plus_where_it_names_it(own, base):
    text = "methods: {mine: {kind: hybrid, label: Mine, objective: 'own_classes:Prior'}}"
    over = {"experiments": {"pendulum": {"methods": ["mine"], "training": {"objective": {"weight": 2.0}}}}}
    merged = config.merge(config.merge(base, yaml.safe_load(text)), config.merge(over, ALONE))
    settings = stage_settings.train(config.validate(merged), "pendulum", "mine", "seeds_0_1_2")
    assert settings["prior"] == {"omega0": [0.5, 3.5]} and settings["training"]["objective"]["weight"] == 2.0
