"""The files of a run: what a version is made from stands before it, and nothing that it does not need."""

from __future__ import annotations

import pytest

from expertaug.stages.files import Files
from shipped import alone, valid

GROUP = "seeds_0_1_2"


@pytest.mark.parametrize(
    ("version", "made"),
    [
        ("aphynity", ["aphynity/model"]),
        ("aphynity=", ["aphynity/model", "aphynity=/model"]),
        ("aphynity+", ["aphynity/model", "aphynity+/augmented", "aphynity+/model"]),
        ("aphynity+~refined", ["aphynity/model", "aphynity+/augmented", "aphynity+/model"]),
        ("aphynity+~flow", ["aphynity/model", "aphynity+~flow/model"]),
        ("aphynity+wide", ["aphynity/model", "aphynity+wide/augmented", "aphynity+wide/model"]),
        ("mean", ["mean/model"]),
    ],
)
def test_what_a_version_is_made_from_stands_before_it(files, version, made):
    named = files.to_scores("pendulum", [version])
    models = list(dict.fromkeys(path for path in named if path.endswith(".safetensors")))
    expected = [f"results/pendulum/{place.replace('/', f'/{GROUP}/')}.safetensors" for place in made]
    assert models == expected
    assert named.index("results/pendulum/data/train.npz") < named.index(models[0])
    assert named[-2:] == [f"results/pendulum/{version}/{GROUP}/{name}" for name in ("metrics.csv", "forecasts.npz")]


def test_versions_are_told_apart_by_what_is_done_to_them(files):
    every = files.variants("pendulum")
    augmented, flows = files.augmented("pendulum"), files.flows("pendulum")
    assert set(augmented) == {v for v in every if "+" in v and "~" not in v}
    assert set(flows) == {v for v in every if v.endswith("~flow")}
    assert set(files.finetuned("pendulum")) - set(augmented) == {v for v in every if v.endswith("=")}
    assert not {"mean", "least_squares", "truth"} & set(files.logged("pendulum"))
    assert files.augmented_samples("pendulum", "aphynity=", GROUP) == []


def test_ranges_that_are_to_be_found_are_files_and_given_ones_are_none(files):
    finding = Files(valid(alone("pendulum"), "experiments: {pendulum: {augmentation: {prior: null}}}"))
    assert finding.prior("pendulum", "aphynity+", GROUP) == [f"results/pendulum/aphynity+/{GROUP}/prior.json"]
    assert finding.prior("pendulum", "least_squares", GROUP) == ["results/pendulum/data/prior.json"]
    assert finding.prior("pendulum", "mean", GROUP) == []
    assert files.prior("pendulum", "aphynity+", GROUP) == files.prior("pendulum", "least_squares", GROUP) == []
    before = finding.to_trainings("pendulum", ["least_squares"])
    model = f"results/pendulum/least_squares/{GROUP}/model.safetensors"
    assert before.index("results/pendulum/data/prior.json") < before.index(model)


def test_groups_of_seeds_have_files_of_their_own():
    two = Files(valid(alone("pendulum"), "{seeds: [4, 5, 6], seeds_per_job: 2}"))
    assert two.of_versions("pendulum", ["mean"], "a", "b") == [
        f"results/pendulum/mean/{group}/{name}" for name in "ab" for group in ("seeds_4_5", "seeds_6")
    ]
