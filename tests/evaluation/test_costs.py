"""What jobs cost: the files of a run, and those of published ones."""

from __future__ import annotations

import json

from expertaug.evaluation.costs import Cost, as_csv, of_run, read, read_published


def test_published_costs_are_read_again_and_stages_are_called_as_they_are_today(tmp_path):
    (tmp_path / "run").mkdir()
    costs = {"train/a": Cost(3.04, 2.0, 100.4), "along/b": Cost(1.5)}
    (tmp_path / "run" / "costs.csv").write_text(as_csv(costs), encoding="utf-8")
    assert read(tmp_path / "run" / "costs.csv") == {"train/a": Cost(3.0, 2.0, 100.0), "during_training/b": Cost(1.5)}
    assert read_published(tmp_path) == {"run": {"train/a": 2.0, "during_training/b": 1.5}}


def test_alone_a_job_takes_its_processor_time_where_that_is_known_and_never_longer_than_the_clock_says():
    assert (Cost(5.0, 3.0).alone_s, Cost(5.0).alone_s, Cost(5.0, 9.0).alone_s) == (5.0 - 2.0, 5.0, 5.0)


def test_the_costs_of_a_run_are_those_that_can_be_read(tmp_path):
    (tmp_path / "train").mkdir()
    (tmp_path / "train" / "a.cost.json").write_text(json.dumps({"seconds": 2, "cpu_seconds": 1.5}))
    (tmp_path / "train" / "b.cost.json").write_text('{"seconds": 2')  # just being written
    (tmp_path / "train" / "c.cost.json").write_text('{"hours": 2}')
    (tmp_path / "train" / "a.log").touch()
    assert of_run(tmp_path) == {"train/a": Cost(2.0, 1.5)}
