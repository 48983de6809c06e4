"""How long a run takes, and what is told at its end."""

from __future__ import annotations

import json
import logging
import threading
from types import SimpleNamespace

import pytest

from expertaug import cli
from expertaug.evaluation import costs
from expertaug.runs.progress import Watch, cancel_timers, logger


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
