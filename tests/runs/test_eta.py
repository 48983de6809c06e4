"""How long a run will take, by the costs of published runs and by what has been measured here."""

from __future__ import annotations

import pytest

from expertaug.runs import eta

COSTS = {"train/a_x_seeds_0_1": 600.0, "train/a_x_seeds_2": 200.0, "train/b_x_seeds_0_1": 1000.0, "simulate/a": 40.0}


def test_what_is_known_of_a_job_best_counts():
    seconds = eta.estimator(COSTS, {})
    assert seconds("train/a_x_seeds_0_1") == 600
    assert seconds("train/a_x@3_seeds_2") == 200, "the method whose grid it is a point of"
    assert seconds("train/a_x_seeds_7_8") == 400, "the mean of the same training with other seeds"
    assert seconds("train/c_y_seeds_0") == 600, "the mean of the stage"
    assert seconds("plot_experiment/3") == eta.UNMEASURED_S


def test_published_costs_are_corrected_by_what_has_been_measured():
    seconds = eta.estimator(COSTS, {"train/b_x_seeds_0_1": 2000.0})
    factor = (2000 + eta.TRUST_S) / (1000 + eta.TRUST_S)
    assert seconds("train/a_x_seeds_0_1") == pytest.approx(600 * factor)
    assert seconds("train/b_x_seeds_0_1") == 2000, "its own measurement"
    assert eta.estimator(COSTS, {"simulate/other": 9.0})("simulate/a") == 40, "nothing to compare"


def test_one_short_job_says_little_of_the_host():
    assert eta.estimator(COSTS | {"simulate/b": 1.0}, {"simulate/b": 10.0})("train/b_x_seeds_0_1") < 1200


def test_remaining_time_is_that_of_all_cores_or_of_the_longest_job():
    seconds = {"a": 100.0, "b": 60.0, "c": 20.0}.__getitem__
    assert eta.remaining({"a": 0.0, "b": 0.0, "c": 0.0}, seconds, 1) == 180
    assert eta.remaining({"a": 0.0, "b": 0.0, "c": 0.0}, seconds, 2) == 100
    assert eta.remaining({"a": 70.0, "b": 200.0, "c": 0.0}, seconds, 1) == 50, "what has run; nothing below zero"
    assert eta.remaining({}, seconds, 2) == 0


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(0, "10 seconds"), (44, "40 seconds"), (100, "2 minutes"), (4920, "82 minutes"), (12600, "3.5 hours")],
)
def test_durations_are_said_as_people_say_them(seconds, said):
    assert eta.text(seconds) == said


def test_the_published_run_with_most_of_the_jobs_is_taken():
    published = {"default": {"a": 1.0, "b": 1.0, "x": 1.0}, "smoke": {"a": 1.0, "b": 1.0, "c": 1.0}}
    assert eta.closest(published, ["a", "b", "c"]) == eta.closest(published, ["a", "b", "c@1"]) == "smoke"
    assert eta.closest(published, ["z"]) is None and eta.closest({}, ["a"]) is None


def test_other_seeds_of_a_published_training_are_no_guess():
    assert eta.learns_alike(COSTS, ["train/a_x_seeds_7"]) and eta.learns_alike(COSTS, ["simulate/z"])
    assert not eta.learns_alike(COSTS, ["train/z_x_seeds_0_1", "simulate/a"])


def test_a_stage_is_known_by_the_median_of_its_published_jobs():
    published = {"a": {"train/x": 1.0, "train/y": 5.0, "report": 2.0}, "b": {"train/z": 30.0}}
    assert eta.typical(published) == {"train/": 5.0, "report/": 2.0}
    assert eta.by_stage({"train/x": 1.0, "report": 0.0, "train/y": 2.0}) == {
        "train": {"train/x": 1.0, "train/y": 2.0},
        "report": {"report": 0.0},
    }
