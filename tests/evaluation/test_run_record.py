"""What a run cost, and what computed it."""

from __future__ import annotations

from expertaug.evaluation import run_record
from expertaug.evaluation.costs import Cost


def test_costs_are_summed_by_stage_the_dearest_first():
    costs = {"evaluate/a": Cost(30, 20, 100), "train/a": Cost(3600, 3500, 900), "train/b": Cost(60)}
    ((_, rows),) = run_record.costs_table(costs).parts
    assert rows == [
        ["train", "2", "1 h 01 min", "1 h 00 min", "900"],
        ["evaluate", "1", "30 s", "30 s", "100"],
        ["all", "3", "1 h 01 min", "1 h 00 min", "900"],
    ]
