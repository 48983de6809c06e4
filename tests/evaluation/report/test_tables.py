"""Cells of the tables of the report."""

from __future__ import annotations

from dataclasses import replace

from fake_runs import mean_of

from expertaug.evaluation.intervals import Interval
from expertaug.evaluation.report import tables


def test_a_gain_carries_a_star_where_it_is_told_apart():
    mean = mean_of("a+", "test", -3.0)
    assert tables.gain(replace(mean, gain=Interval(0.5, 0.2, 0.8, 0.01))) == "0.50* [0.20, 0.80]"
    assert tables.gain(replace(mean, gain=Interval(0.5, -0.1, 0.8, 0.2))) == "0.50 [−0.10, 0.80]"
    assert tables.gain(mean) == tables.gain(None) == ""
