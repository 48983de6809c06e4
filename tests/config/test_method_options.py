"""What an experiment's overrides make of a method: another encoder, its own objective's options, p⁺ in training."""

from pathlib import Path

import pytest
import yaml

from expertaug.config import jobs, report_parameters, stage_settings
from expertaug.config import load as config
from expertaug.errors import InputError

HVAE = """
methods: {variational: {kind: hybrid, objective: hvae, label: V}}
experiments:
  pendulum:
    methods: [aphynity, variational]
    augmented: [variational]
    augmentations: {narrow: null, wide: null}
    overrides:
      variational:
        model: {encoder: {kind: two_step, latent: 2}, interaction: {kind: damping}}
        training: {objective: {alpha: 0.5}}
"""


@pytest.fixture(scope="module")
def base() -> dict:
    """The default configuration's pendulum alone: no other experiment inherits what is changed here."""
    found = config.load([Path(__file__).parents[2] / "config" / "config.yaml"])
    return found | {"run": ["pendulum"], "experiments": {"pendulum": found["experiments"]["pendulum"]}}


def settings(base, method, more="{}"):
    merged = config.merge(config.merge(base, yaml.safe_load(HVAE)), yaml.safe_load(more))
    valid = config.validate(merged)
    return stage_settings.train(valid, "pendulum", method, next(iter(jobs.seed_groups(valid))))


def test_another_kind_brings_its_own_arguments(base):
    model = settings(base, "variational")["model"]
    assert model["encoder"] == {"kind": "two_step", "latent": 2}
    assert model["interaction"] == {"kind": "damping"}


def test_each_method_gets_the_options_of_its_objective(base):
    assert settings(base, "variational")["training"]["objective"] == {"alpha": 0.5}
    assert "lambda0" in settings(base, "aphynity")["training"]["objective"]


def test_options_of_methods_that_were_left_out_do_no_harm(base):
    only = "experiments: {pendulum: {methods: [variational], augmented: [], controls: [], flows: [], refined: []}}"
    assert settings(base, "variational", only)["training"]["objective"] == {"alpha": 0.5}


def test_only_objectives_that_need_p_plus_depend_on_it(base):
    assert settings(base, "variational")["prior"] == {"omega0": [0.5, 3.5]}
    assert "prior" not in settings(base, "aphynity")


@pytest.mark.parametrize(
    ("over", "expected"),
    [
        ("training: {objective: {lambda0: 1.0}}", r"overrides\.variational\.training\.objective\.lambda0: unknown key"),
        ("model: {encoder: {hidden: 3}}", r"overrides\.variational\.model\.encoder\.hidden: unknown key"),
    ],
)
def test_what_another_class_takes_is_refused(base, over, expected):
    with pytest.raises(InputError, match=expected):
        settings(base, "variational", f"experiments: {{pendulum: {{overrides: {{variational: {{{over}}}}}}}}}")


def test_an_objective_that_needs_p_plus_finds_it_where_none_is_given(base):
    merged = config.merge(base, yaml.safe_load(HVAE))
    del merged["experiments"]["pendulum"]["augmentation"]
    merged["experiments"]["pendulum"] |= {"augmented": [], "augmentations": {}, "studies": {}}
    valid = config.validate(merged)
    assert stage_settings.train(valid, "pendulum", "variational", "seeds_0_1_2")["prior"] == "own"
    assert jobs.finds_prior_to_train(valid, "pendulum", "variational")
    assert not jobs.finds_prior_to_train(valid, "pendulum", "aphynity")


def test_tables_and_figures_are_told_each_method_s_own_p_plus(base):
    prior = "experiments: {pendulum: {overrides: {aphynity: {augmentation: {prior: {omega0: [0.25, 3.5]}}}}}}"
    valid = config.validate(config.merge(base, yaml.safe_load(prior)))
    told = report_parameters.plot(valid, "pendulum")["priors"]
    own, other = {"omega0": [0.25, 3.5]}, {"omega0": [0.5, 3.5]}
    versions = ["aphynity", "aphynity~refined", "aphynity=", "aphynity+", "aphynity+~refined"]
    versions += ["aphynity+~flow", "aphynity+~flow~refined"]
    assert {label: p for label, p in told.items() if p != other} == dict.fromkeys(versions, own)
    assert report_parameters.study(valid, "pendulum", "prior_width")["priors"]["aphynity"][""] == own


def test_fits_without_a_training_are_solved_as_the_trainings_are(base):
    lawson = "{experiments: {pendulum: {training: {solver: {method: lawson4}}}}}"
    for method in ("least_squares", "truth"):
        assert settings(base, method)["training"]["solver"]["method"] == "ab5"
        assert settings(base, method, lawson)["training"]["solver"]["method"] == "lawson4"


@pytest.mark.parametrize("part", ["encoder", "interaction"])
def test_a_list_in_a_parts_place_is_one_line(base, part):
    merged = config.merge(base, yaml.safe_load(HVAE))
    merged["experiments"]["pendulum"]["overrides"]["variational"]["model"] = {part: [1]}
    with pytest.raises(InputError, match=f"overrides.variational.model.{part}: found .1.; give a mapping of keys"):
        config.validate(merged)
