"""Flows in the configuration: versions, settings of their stage, and mistakes."""

import pytest

from expertaug.config import jobs, show, stage_settings
from expertaug.config.load import default_files, load, validate
from expertaug.errors import InputErrors

VERSIONS = ("aphynity+", "aphynity+~flow", "aphynity+~flow~refined")


def completed(**pendulum):
    given = load(default_files())
    experiment = {**given["experiments"]["pendulum"], **pendulum}
    return validate({**given, "run": ["pendulum"], "experiments": {"pendulum": experiment}})


def test_a_flow_follows_its_augmented_version_and_may_be_refined():
    over = {"augmented": ["aphynity"], "refined": ["aphynity+~flow"], "controls": []}
    config = completed(methods=["aphynity", "hvae"], flows=["aphynity", "hvae"], **over)
    found = jobs.variants(config, "pendulum")
    assert found == ["aphynity", "aphynity+", "aphynity+~flow", "aphynity+~flow~refined", "hvae", "hvae+~flow"]


def test_an_alternating_method_is_amortised_by_a_flow():
    over = {"refined": ["alternating+~flow"], "controls": [], "augmented": [], "augmentations": {}}
    config = completed(flows=["alternating"], methods=["alternating"], **over)
    assert jobs.variants(config, "pendulum") == ["alternating", "alternating+~flow", "alternating+~flow~refined"]
    told = stage_settings.flow(config, "pendulum", "alternating+~flow", "seeds_0_1_2")
    assert told["label"] == "Alternating+ flow" and told["prior"] == {"omega0": [0.5, 3.5]}
    with pytest.raises(InputErrors, match="it is fitted to each window already"):
        completed(flows=["alternating"], methods=["alternating"], **over | {"refined": ["alternating"]})


def test_its_stage_gets_its_prior_noise_and_own_settings():
    over = {"aphynity": {"flow": {"bins": 5}}}
    config = completed(flows=["aphynity", "hvae"], overrides=over, flow={"steps": 7})
    one, other = (stage_settings.flow(config, "pendulum", f"{m}+~flow", "seeds_0_1_2") for m in ("aphynity", "hvae"))
    assert (one["flow"]["bins"], one["flow"]["steps"]) == (5, 7) and other["flow"]["bins"] == 8
    assert one["label"] == "APHYNITY+ flow" and one["prior"] == {"omega0": [0.5, 3.5]} and one["noise"] == 0.01
    assert set(one["choices"]) == {"augmentation_noise", "augmented_x", "augmented_z_a"}
    wide = stage_settings.flow(config, "pendulum", "aphynity+wide~flow", "seeds_0_1_2")
    assert wide["prior"] == {"omega0": [0.1, 7.0]}


def test_windows_of_its_own_making_begin_where_its_draws_do():
    over = {"augmented": ["aphynity"], "controls": [], "refined": ["aphynity+~flow"]}
    config = completed(flows=["aphynity"], methods=["aphynity"], flow={"resample_x": True}, **over)
    found = {v: stage_settings.evaluate(config, "pendulum", v, "seeds_0_1_2")["own"]["resample_x"] for v in VERSIONS}
    assert found == {"aphynity+": False, "aphynity+~flow": True, "aphynity+~flow~refined": True}


def test_what_it_runs_with_is_shown():
    given = load(default_files())
    given["experiments"]["pendulum"]["flows"] = ["aphynity"]
    lines = list(show.show(given, "pendulum", "aphynity"))
    start = next(k for k, line in enumerate(lines) if line.startswith("flow aphynity+~flow"))
    assert any("flow.bins: 8" in line and "default" in line for line in lines[start:])
    assert any("flow.steps: 4000" in line and "pendulum.yaml" in line for line in lines[start:])


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"flows": ["mean"]},
            "flows[0]: 'mean' is of kind mean; only methods of kind hybrid and alternating have a posterior",
        ),
        ({"flows": ["aphinity"]}, "flows[0]"),
        ({"flow": {"bins": 1}}, "flow.bins: found 1; give 2 or more"),
        ({"refined": ["aphynity+~flaw"]}, "refined"),
    ],
)
def test_mistakes(changed, message):
    with pytest.raises(InputErrors) as raised:
        completed(**changed)
    assert message in str(raised.value)


def test_a_p_plus_that_is_not_given_finds_its_own_ranges():
    given = load(default_files())
    one = {k: v for k, v in given["experiments"]["pendulum"].items() if k not in ("augmentation", "augmentations")}
    one |= {"flows": ["aphynity"], "augmented": [], "controls": [], "methods": ["aphynity"], "refined": []}
    config = validate({**given, "run": ["pendulum"], "experiments": {"pendulum": one}})
    assert stage_settings.flow(config, "pendulum", "aphynity+~flow", "seeds_0_1_2")["prior"] == "own"
    assert jobs.finds_prior(config, "pendulum", "aphynity+~flow") == "aphynity+"
    assert jobs.list_found_priors(config, "pendulum") == ["aphynity+"]
    found = stage_settings.own_prior(config, "pendulum", "aphynity+", "seeds_0_1_2")
    assert found["windows"] == [] and found["budget"] == 2.0 and found["noise"] == 0.01


def test_further_priors_may_find_their_own_ranges_too():
    own = {"augmentations": {"own": {"windows": ["test"], "methods": ["aphynity"]}}}
    config = completed(**own, augmented=["aphynity"], flows=[], refined=[], controls=[], methods=["truth", "aphynity"])
    assert jobs.list_found_priors(config, "pendulum") == ["aphynity+own"]
    assert stage_settings.augment(config, "pendulum", "aphynity+own", "seeds_0_1_2")["prior"] == "own"
    assert stage_settings.own_prior(config, "pendulum", "aphynity+own", "seeds_0_1_2")["windows"] == ["test"]
    everywhere = completed(augmentation={"prior": None}, augmentations={}, refined=["hvae"], flows=[], controls=[])
    found = jobs.list_found_priors(everywhere, "pendulum")
    assert {"", "aphynity+", "hvae+"} <= set(found) and len(found) == len(set(found))
    assert jobs.finds_prior(everywhere, "pendulum", "least_squares") == ""
    alone = stage_settings.own_prior(everywhere, "pendulum", "", None)
    assert alone["build"]["kind"] == "least_squares" and alone["system"]["name"] == "pendulum"
    with pytest.raises(InputErrors, match=r"augmentations\.own\.windows"):
        completed(augmentations={"own": {"windows": ["tset"], "methods": ["aphynity"]}})
