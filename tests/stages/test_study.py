"""A study hands on what its command names, and makes a table and, mostly, a figure."""

from __future__ import annotations

import argparse
import sys
from types import SimpleNamespace

from expertaug.stages.study import StudyStage


class Count(StudyStage):
    """count"""

    name = "count-all"
    code = "own_count"
    paths = ("models", "data")


class Listed(Count):
    product, draws = "list", False


def test_paths_are_handed_on_in_order_before_the_outputs_and_the_job(monkeypatch):
    given = []
    monkeypatch.setitem(sys.modules, "own_count", SimpleNamespace(run_stage=lambda *a: given.append(a)))
    Count.run(argparse.Namespace(data="d", output=["o"], models=["m"], further=1), "job")
    assert given == [(["m"], "d", ["o"], "job")]


def test_it_makes_a_table_and_a_figure_of_its_own_name_unless_it_says_otherwise():
    (both,), (alone,) = Count.products(), Listed.products()
    assert list(both.files("swing", ("png",))) == [
        *(f"tables/swing_count_all.{end}" for end in ("csv", "md", "tex")),
        "figures/swing_count_all.png",
    ]
    assert [path for path in alone.files("swing") if "figures" in path] == [] and alone.name == "list"
    assert Count.names("swing", "count_all") == ("swing",)
