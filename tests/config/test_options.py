"""Options of the classes that a configuration names: the package's own are typed, others are asked themselves."""

from __future__ import annotations

import inspect

import pytest
import yaml

from expertaug import registry, systems
from expertaug.config import load as config
from expertaug.config import options
from expertaug.learning.settings import ALL_PARTS, OBJECTIVES
from expertaug.models.settings import ENCODERS, INTERACTIONS
from expertaug.settings import is_left_out
from expertaug.systems.settings import SYSTEMS
from shipped import PENDULUM, default, refusals

KINDS = {"encoder": ENCODERS, "interaction": INTERACTIONS, "objective": OBJECTIVES}
GIVEN = {"system", "times", "latent", "seeds", "choices", "prior", "functions"}  # not by a configuration


@pytest.fixture(scope="module")
def base() -> dict:
    return config.merge(default(), {"run": ["pendulum"]})


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
    found = refusals(base, PENDULUM.format(over))
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
    assert expected in refusals(base, text)[0]


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


def test_what_an_objective_takes_is_known_before_it_is_made():
    for kind, settings in OBJECTIVES.items():
        arguments = inspect.signature(registry.find(ALL_PARTS["objective"], kind, "objective")).parameters
        assert options.needs_prior(kind, "objective") == ("prior" in arguments)
        assert all(options.takes_option(kind, option) for option in settings.model_fields)
        assert not options.takes_option(kind, "no_such_option")
    assert not options.needs_prior("aphinity", "objective"), "what it is called wrongly is told elsewhere"
    found, errors = options.find_objective("aphinity", "here")
    assert found is None and str(errors[0]).startswith("here: 'aphinity' is no objective; did you mean 'aphynity'?")


def test_an_encoder_may_see_a_systems_known_inputs():
    driven, wrong = options.describe_system({"name": "driven_pendulum"}, "system")
    assert not wrong and list(driven.seen) == [*driven.state, "torque"]
    part = {"kind": "window", "windows": {"torque": [0.0, 1.0]}, "layers": [4], "latent": 1}
    assert not list(options.check_part("encoder", part, "encoder", driven, 1.0))
    plain, _ = options.describe_system({"name": "pendulum"}, "system")
    (error,) = options.check_part("encoder", part, "encoder", plain, 1.0)
    assert error.where == "encoder.windows.torque"
