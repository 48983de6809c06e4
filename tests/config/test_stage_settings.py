"""What each job is told of the configuration: what concerns it, and nothing that does not."""

from __future__ import annotations

import pytest
import yaml

from expertaug.config import jobs, recording_settings, report_parameters, stage_settings
from expertaug.config import load as config
from expertaug.errors import InputErrors
from expertaug.stages import STAGES, planned


def test_slices_hold_only_what_their_stage_uses(base):
    found = config.validate(base)
    group = "seeds_0_1_2"
    other = config.validate(
        config.merge(
            base,
            {
                "recordings": {"rendered": {"count": 3}},
                "experiments": {
                    "pendulum": {
                        "choices": {"resample": "once", "forecast_start": "y_t1"},
                        "finetuning": {"epochs": 7},
                        "data": {"sets": {"test": {"size": 7}}},
                    }
                },
            },
        )
    )
    same = [
        (stage_settings.train, "pendulum", "aphynity", group),
        (stage_settings.augment, "pendulum", "aphynity", group),
        (stage_settings.simulate, "pendulum", "train"),
        (recording_settings.render_video,),
    ]
    for stage, *names in same:
        assert stage(found, *names) == stage(other, *names)
    changed = [
        (stage_settings.finetune, "pendulum", "aphynity", group),
        (stage_settings.evaluate, "pendulum", "aphynity+", group),
        (stage_settings.simulate, "pendulum", "test"),
    ]
    for stage, *names in changed:
        assert stage(found, *names) != stage(other, *names)


def test_noise_follows_the_preset(base):
    paper = config.validate(config.merge(base, {"preset": "paper"}))
    assert stage_settings.simulate(paper, "pendulum", "train")["data"]["noise"] == 0.0
    assert stage_settings.simulate(config.validate(base), "pendulum", "train")["data"]["noise"] == 0.01


def test_experiments_and_methods_may_override(base: dict) -> None:
    over = "{choices: {resample: epoch}, overrides: {ml_only: {model: {interaction: {layers: [7]}}}}}"
    changed = config.validate(config.merge(base, yaml.safe_load(f"experiments: {{pendulum: {over}}}")))
    trained = [stage_settings.train(changed, "pendulum", method, "seeds_0_1_2") for method in ("ml_only", "aphynity")]
    own = base["experiments"]["pendulum"]["model"]["interaction"]
    assert trained[0]["model"]["interaction"]["layers"] == [7] and trained[1]["model"]["interaction"] == own
    assert stage_settings.finetune(changed, "pendulum", "aphynity", "seeds_0_1_2")["choices"]["resample"] == "epoch"


# An experiment without studies, on which the next is built.
PLAIN = """
run: [plain]
experiments:
  plain:
    based_on: pendulum
    methods: [mean, ml_only, aphynity]
    augmented: [aphynity]
    augmentations: {narrow: null, wide: null}
"""


STUDIES = """
experiments:
  plain:
    data: {sets: {near: {size: 5, z_e: {omega0: [1.5, 3.1]}, z_a: {alpha: [0.6, 1.0]}}}}
    augmentations: {wide: {prior: {omega0: [0.1, 7.0]}}}
    studies:
      during_training: {method: aphynity, epochs: [5, 1]}
      out_of_expertise: {distances: [none, near], panels: {z_a: [test, near]}, overview: near}
  x: {based_on: plain, augmentations: {wide: null}, studies: {during_training: null}}
"""


def test_studies_change_only_the_jobs_that_they_need(base: dict) -> None:
    base = config.merge(base, yaml.safe_load(PLAIN))
    group, plain = "seeds_0_1_2", config.validate(base)
    assert jobs.studies(plain, "plain") == []
    found = config.validate(config.merge(base, yaml.safe_load(STUDIES)))
    assert jobs.studies(found, "plain") == ["during_training", "out_of_expertise", "prior_width"]
    assert jobs.studies(found, "x") == ["out_of_expertise"], "null takes away"
    assert jobs.variants(found, "plain") == jobs.variants(plain, "plain")
    assert "aphynity+wide" in jobs.further_variants(found, "plain")
    assert jobs.list_studied(found, "plain", "prior_width")[:2] == ["aphynity", "aphynity+"]
    trained = stage_settings.train(found, "plain", "aphynity", group)
    assert trained.pop("snapshots") == [1, 5]
    assert trained == stage_settings.train(plain, "plain", "aphynity", group)
    assert stage_settings.train(found, "plain", "ml_only", group) == stage_settings.train(
        plain, "plain", "ml_only", group
    )
    for stage in (stage_settings.augment, stage_settings.finetune):
        assert stage(found, "plain", "aphynity+", group) == stage(plain, "plain", "aphynity+", group)
    wide = stage_settings.augment(found, "plain", "aphynity+wide", group)
    assert wide["prior"] == {"omega0": [0.1, 7.0]} and wide["method"] == "aphynity+wide"
    assert stage_settings.finetune(found, "plain", "aphynity+wide", group)["label"] == "APHYNITY+ (wide)"
    assert stage_settings.evaluate(found, "plain", "aphynity", group)["sets"][-1] == "near"
    along = stage_settings.during_training(found, "plain", "aphynity", group)
    assert along["finetune"] == stage_settings.finetune(found, "plain", "aphynity+", group)
    assert along["finetune_epochs"] == [1, 10]
    assert report_parameters.tabulate(found, "plain") == report_parameters.tabulate(plain, "plain")


def test_a_hybrid_s_constants_are_those_that_units_call_shared(base):
    text = (
        "{run: [pendulum], experiments: {pendulum: {methods: [aphynity, aphynity_shared, hvae_shared], augmented: "
        "[hvae_shared], augmentations: {narrow: null, wide: null}, controls: [], flows: [], refined: "
        "[aphynity_shared], refinement: {units: {omega0: UNIT}}}}}"
    )
    found = config.validate(config.merge(base, yaml.safe_load(text.replace("UNIT", "shared"))))
    told = [stage_settings.train(found, "pendulum", name, "seeds_0_1_2") for name in ("aphynity_shared", "hvae_shared")]
    assert all(job["shared"] == ["omega0"] and "refinement" not in job for job in told)
    assert "shared" not in stage_settings.train(found, "pendulum", "aphynity", "seeds_0_1_2")
    refined = stage_settings.evaluate(found, "pendulum", "aphynity_shared~refined", "seeds_0_1_2")
    assert refined["refinement"]["settings"]["units"] == {"omega0": "shared"} and "own" not in refined
    with pytest.raises(InputErrors, match=r"methods\[1\]: 'aphynity_shared' fits what windows share, and nothing is"):
        config.validate(config.merge(base, yaml.safe_load(text.replace("UNIT", "window"))))


def test_a_flow_over_constants_of_sensors_is_refused(base):
    text = (
        "{run: [pendulum], experiments: {pendulum: {methods: [alternating_shared], augmented: [], augmentations: "
        "{narrow: null, wide: null}, controls: [], flows: [alternating_shared], refined: [], refinement: {units: "
        "{omega0: shared}SENSORS}}}}"
    )
    config.validate(config.merge(base, yaml.safe_load(text.replace("SENSORS", ""))))
    sensed = text.replace("SENSORS", ", sensors: {omega: {scale: shared}}")
    with pytest.raises(InputErrors, match=r"flows\[0\]: 'alternating_shared' has constants of sensors"):
        config.validate(config.merge(base, yaml.safe_load(sensed)))


def test_what_windows_share_is_told_only_to_what_shares_it(base):
    methods = "methods: [mean, least_squares, least_squares_shared, truth, aphynity, alternating, alternating_shared]"
    none = "augmented: [], augmentations: {narrow: null, wide: null}, controls: [], flows: [], refined: [aphynity]"
    text = f"{{run: [pendulum], experiments: {{pendulum: {{UNITS {methods}, {none}}}}}}}"
    shared = text.replace("UNITS", "refinement: {units: {omega0: shared}},")
    each = text.replace("UNITS", "").replace("least_squares_shared, ", "").replace(", alternating_shared", "")
    with_units, without = (config.validate(config.merge(base, yaml.safe_load(one))) for one in (shared, each))
    jobs_of = {}
    for name, found in (("with", with_units), ("without", without)):
        jobs_of[name] = {
            (stage, *names): STAGES[stage].settings_of(found, *names)
            for stage, names in planned.plan(found)
            if stage in ("train", "alternate", "share", "evaluate", "validity", "dissipation")
        }
    sharing = {"least_squares_shared", "alternating_shared"}
    own = {key: one for key, one in jobs_of["with"].items() if not sharing & {*key}}
    refined = ("evaluate", "pendulum", "aphynity~refined", "seeds_0_1_2")
    assert {key for key, one in own.items() if one != jobs_of["without"][key]} == {refined}
    told = {key for key, one in jobs_of["with"].items() if '"omega0": "shared"' in one}
    stages = {"share": "least_squares_shared", "alternate": "alternating_shared"}
    assert told == {refined, *((stage, "pendulum", method, "seeds_0_1_2") for stage, method in stages.items())}
