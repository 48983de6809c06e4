"""Rows of a table lead to the runs that they are of."""

from __future__ import annotations

from fake_runs import mean_of

from expertaug.evaluation.report.links import Dashboard
from expertaug.evaluation.table import Table
from expertaug.tracking.settings import Tracking

LONG = [mean_of("a", "test", -1.0), mean_of("a+", "test", -2.0)]
TABLE = Table(["method", "log-MSE"], [("swing", [["a+", "−2"], ["nobody", "0"]]), ("other", [["a", "−1"]])])


def dashboard(**experiments):
    tracking = Tracking(enabled=True, uri="sqlite:///r/m.db", experiment="e", experiments=experiments)
    return Dashboard(tracking)


def test_a_row_leads_to_the_runs_of_its_version_and_one_of_no_version_nowhere():
    found = dashboard(swing="3")
    links = found.of(TABLE, "swing", LONG)
    assert links.keys() == {("swing", "a+"), ("other", "a")}
    assert "/experiments/3/" in links["swing", "a+"] and links["swing", "a+"].endswith("%27a%2B%27")
    assert "m.db" in found.command


def test_of_several_experiments_each_part_leads_to_its_own():
    links = dashboard(swing="3", circle="4").of_several(TABLE, {"swing": ("swing", LONG), "other": ("circle", LONG)})
    assert links.keys() == {("swing", "a+"), ("other", "a")}
    assert "/experiments/3/" in links["swing", "a+"] and "/experiments/4/" in links["other", "a"]


def test_without_a_store_nothing_leads_anywhere():
    assert Dashboard(None).of(TABLE, "swing", LONG) == {} and Dashboard(None).command is None
