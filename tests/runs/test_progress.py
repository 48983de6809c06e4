"""How long a run takes, and what is told at its end."""

from __future__ import annotations

import json
import logging
import threading
from types import SimpleNamespace

import pytest

from expertaug import cli
from expertaug.evaluation import costs
from expertaug.runs import eta
from expertaug.runs.progress import Watch, cancel_timers, logger

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


def test_costs_are_read_from_published_runs_and_logs(tmp_path):
    (tmp_path / "long").mkdir()
    (tmp_path / "long" / "costs.csv").write_text("job,seconds,peak_memory_mb\ntrain/a,600.5,300\nalong/b,9,1\n")
    (tmp_path / "logs" / "train").mkdir(parents=True)
    write_cost(tmp_path, "train/a", seconds=61.25, cpu_seconds=60.0, peak_memory_mb=300)
    for k, text in enumerate(('{"seconds": 1', "[1]", '{"seconds": "many"}', '{"seconds": null}', '{"minutes": 1}')):
        (tmp_path / "logs" / "train" / f"broken_{k}.cost.json").write_text(text)
    assert costs.read_published(tmp_path) == {"long": {"train/a": 600.5, "during_training/b": 9.0}}, "named as today"
    assert costs.of_run(tmp_path / "logs") == {"train/a": costs.Cost(61.25, 60.0, 300)}
    assert costs.as_csv(costs.of_run(tmp_path / "logs")).splitlines()[1] == "train/a,61.2,60.0,300"


def write_cost(folder, job: str, **values: float) -> None:
    (folder / "logs" / f"{job}.cost.json").write_text(json.dumps(values))


def test_the_command_line_writes_what_a_job_took(tmp_path):
    show = ["config", "--log", str(tmp_path / "logs" / "show.log"), "show", "pendulum"]
    assert cli.main([*show, "aphynity"]) == 0
    cost = costs.of_run(tmp_path / "logs")["show"]
    assert cost.cpu_seconds > 0 and 0 < cost.seconds < 600 and cost.peak_memory_mb > 1
    (tmp_path / "logs" / "show.cost.json").unlink()
    assert cli.main([*show, "aphinity"]) == 2
    assert not costs.of_run(tmp_path / "logs"), "what failed tells no cost"


def test_the_published_run_with_most_of_the_jobs_is_taken():
    published = {"default": {"a": 1.0, "b": 1.0, "x": 1.0}, "smoke": {"a": 1.0, "b": 1.0, "c": 1.0}}
    assert eta.closest(published, ["a", "b", "c"]) == eta.closest(published, ["a", "b", "c@1"]) == "smoke"
    assert eta.closest(published, ["z"]) is None and eta.closest({}, ["a"]) is None


class Dag:
    """Jobs as Snakemake's graph of jobs shows them: None is a target's."""

    def __init__(self, folder, *names):
        self.all = [
            SimpleNamespace(
                jobid=k,
                rule=SimpleNamespace(name="rule", norun=name is None),
                log=[str(folder / "logs" / f"{name}.log")] if name else [],
            )
            for k, name in enumerate(names)
        ]

    def needrun_jobs(self):
        return iter(self.all)


@pytest.fixture
def watch(tmp_path, caplog):
    (tmp_path / "published" / "long").mkdir(parents=True)
    (tmp_path / "published" / "long" / "costs.csv").write_text(
        "job,seconds,peak_memory_mb\ntrain/a,900,1\ntrain/b,300,1\n"
    )
    found = Watch(tmp_path / "results", tmp_path / "published", ["a", "b"])
    caplog.set_level(logging.INFO, logger.name)
    yield found
    logger.removeHandler(found)


def test_a_run_is_announced_and_followed(watch, tmp_path, caplog):
    watch.start(Dag(tmp_path / "results", "train/a", "train/b", None), 1)
    assert caplog.messages[0].startswith("expertaug ") and caplog.messages[0].endswith(": a, b")
    assert caplog.messages[1:] == ["About 20 minutes for 2 jobs on 1 core (by the costs of the published run 'long')."]
    logger.info("", extra={"event": "job_finished", "job_id": 1})
    logger.info("", extra={"event": "progress"})
    assert "About 15 minutes left for 1 job." in caplog.messages


def test_a_run_says_what_it_does_stage_by_stage(watch, tmp_path, caplog):
    watch.start(Dag(tmp_path / "results", "train/a", "train/b", "validity/a", "during_training/a", None), 1)
    assert caplog.messages[1:-1] == [
        "What is to be done:",
        "  train     2 jobs  about 20 minutes",
        "  others    2 jobs  cost not known: during training, validity",
    ]
    assert caplog.messages[-1].startswith("At least 20 minutes for 4 jobs on 1 core")


def test_nothing_is_estimated_from_nothing(watch, tmp_path, caplog):
    (tmp_path / "published" / "long" / "costs.csv").unlink()
    watch.start(Dag(tmp_path / "results", "train/other"), 2)
    assert caplog.messages[1:] == ["1 job on 2 cores; the time left is estimated once some have ended."]


def test_a_new_experiment_is_not_promised_the_time_of_a_toy_run(watch, tmp_path, caplog):
    """A toy run shares the report with every run; how long another experiment trains it does not know."""
    (tmp_path / "published" / "toy").mkdir()
    (tmp_path / "published" / "toy" / "costs.csv").write_text("job,seconds\ntrain/c,6\nreport,6\n")
    watch.start(Dag(tmp_path / "results", "train/own", "train/other", "report"), 1)
    guess = "About 10 minutes for 3 jobs on 1 core (a guess: no published run has these experiments)."
    assert caplog.messages[-1] == guess, "the median of 6, 300 and 900 seconds for each training"


def test_other_seeds_of_a_published_training_are_no_guess():
    assert eta.learns_alike(COSTS, ["train/a_x_seeds_7"]) and eta.learns_alike(COSTS, ["simulate/z"])
    assert not eta.learns_alike(COSTS, ["train/z_x_seeds_0_1", "simulate/a"])


def test_broken_costs_end_no_run(watch, tmp_path, caplog):
    (tmp_path / "published" / "long" / "costs.csv").write_text("job,seconds\ntrain/a,many\n")
    watch.start(Dag(tmp_path / "results", "train/a"), 2)
    assert "cannot be estimated" in caplog.messages[-1]
    logger.info("", extra={"event": "progress"})


def test_each_refusal_is_told_once_with_its_log(watch, tmp_path):
    watch.start(Dag(tmp_path / "results", "train/a"), 1)
    logs = [tmp_path / f"{k}.log" for k in range(4)]
    logs[0].write_text(
        "t INFO begins\n2026-01-01 10:00:00,000 ERROR expertaug train: data: no such file; run simulate\n"
    )
    logs[1].write_text("t ERROR expertaug augment: failed\nTraceback (most recent call last):\n  …\nValueError: odd\n")
    logs[2].write_text("t INFO begins\n")
    for k, path in enumerate(logs):
        fields = {"event": "job_error", "jobid": k, "rule_name": f"rule_{k}", "log": [str(path)]}
        logger.error("", extra=fields)
        logger.error("", extra=fields)
    logger.info("", extra={"event": "job_finished", "job_id": 3})  # went well when it was tried again
    assert watch.refusals() == [
        f"expertaug train: data: no such file; run simulate (log: {logs[0]})",
        f"expertaug augment: failed: ValueError: odd (log: {logs[1]})",
        f"rule_2: ended without a word (killed, or short of memory?) (log: {logs[2]})",
    ]


def test_a_run_ends_with_where_to_look(tmp_path):
    watch = Watch(tmp_path, tmp_path)
    assert watch.where_to_look() == []  # as after a run of a stage that makes no table, without a store
    (tmp_path / "report.html").touch()
    for name in ("tables", "figures", "mlflow"):
        (tmp_path / name).mkdir()
    places = [f"Report: {tmp_path}/report.html", f"Tables: {tmp_path}/tables", f"Figures: {tmp_path}/figures"]
    assert watch.where_to_look() == places
    place = "/#/experiments/3/runs?workflowType=machine_learning&viewStateShareKey=scores"
    for uri, command, address in (
        ("sqlite:///r/m.db", " mlflow server --backend-store-uri sqlite:///r/m.db, then", "http://127.0.0.1:5000"),
        ("http://host:80/", "", "http://host:80"),
    ):
        record = {"enabled": True, "uri": uri, "experiment": "e", "experiments": {"swing": "3", "slide": "4"}}
        (tmp_path / "mlflow" / "tracking.json").write_text(json.dumps(record))
        pages = [f"  swing: {address}{place}", f"  slide: {address}{place.replace('3', '4', 1)}"]
        assert watch.where_to_look()[-3:] == [f"Dashboard:{command}", *pages]
    (tmp_path / "mlflow" / "tracking.json").write_text('{"enabled": false}')
    assert watch.where_to_look() == places


def test_a_run_does_not_wait_for_timers():
    timer = threading.Timer(60, lambda: None)
    timer.start()
    cancel_timers()
    timer.join(5)
    assert not timer.is_alive()
