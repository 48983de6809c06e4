"""Figures of dots: where they are, and that all of them can be read."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from fake_runs import LABELS, pairs, rows_of, tables_of, write_metrics
from matplotlib.image import imread
from whole_figures import assert_nothing_is_cut

from expertaug import plotting
from expertaug.evaluation import dots
from expertaug.evaluation.dots import run_stage as overview
from expertaug.evaluation.settings import OverviewExperiment, OverviewJob, PlotJob
from nightly import others_slow


def test_dots_are_at_the_means(tmp_path):
    metrics = write_metrics(tmp_path)
    (path,) = tables_of(metrics)
    table = pd.read_csv(path)
    known = table["label"] != "Mean"  # of which no samples are kept
    table.assign(low=(table["mean"] - 0.3).where(known), high=(table["mean"] + 0.5).where(known)).to_csv(path)
    figure = dots.log_mse(rows_of([path]), PlotJob(**pairs()))
    plotting.save_all({tmp_path / "dots": figure})
    table = pd.concat(map(pd.read_csv, metrics)).query("metric == 'log_mse_sum'")
    axis = figure.axes[0]
    marks = [line for line in axis.lines if not line.get_label().startswith("_")]  # the ends of an error bar have none
    places = sorted(line.get_xdata()[0] for line in marks)
    assert places == pytest.approx(sorted(table.groupby(["label", "set"])["value"].mean()))
    means = table[table["label"] != "Mean"].groupby(["label", "set"])["value"].mean()
    ends = sorted(tuple(c.get_segments()[0][:, 0]) for c in axis.collections)
    assert ends == [pytest.approx((mean - 0.3, mean + 0.5)) for mean in sorted(means)], "the table's intervals"
    assert not figure.get_suptitle()
    assert (tmp_path / "dots.pdf").read_bytes().startswith(b"%PDF")
    assert imread(tmp_path / "dots.png").std() > 0.1
    assert_nothing_is_cut(figure)


def test_where_there_is_an_iid_test_set_figures_leave_validation_out(tmp_path):
    metrics = write_metrics(tmp_path)
    without = dots.log_mse(rows_of(tables_of(metrics)), PlotJob(**pairs()))
    for path in metrics:
        table = pd.read_csv(path)
        pd.concat([table, table[table["set"] == "validation"].assign(set="iid")]).to_csv(path, index=False)
    figure = dots.log_mse(rows_of(tables_of(metrics)), PlotJob(**pairs()))
    entries = [[text.get_text() for text in each.legends[0].get_texts()] for each in (without, figure)]
    assert entries == [["train", "validation (set of choices)", "test (OOD)"], ["train", "IID test", "test (OOD)"]]
    assert_nothing_is_cut(figure)


@pytest.mark.parametrize("seeds", others_slow([[0, 1, 2], [0]]))
def test_several_experiments_and_long_labels_fit(tmp_path, monkeypatch, seeds):
    from fake_runs import SWING

    name = "Expert only (equal point masses)"
    monkeypatch.setitem(SWING, name, SWING["Expert only"])
    monkeypatch.setitem(SWING, "Other+", SWING["Hybrid+"])
    labels = [*LABELS, name, "Other+"]
    metrics = write_metrics(tmp_path, labels=labels, seeds=seeds)
    for paths in (metrics, metrics + write_metrics(tmp_path, "double_swing", seeds, labels)):
        rows = rows_of(tables_of(paths))
        assert_nothing_is_cut(dots.log_mse(rows, PlotJob(labels=[])))
        figure = dots.parameter_errors(rows, PlotJob(labels=[]))
        assert_nothing_is_cut(figure)
    assert all(axis.get_xlabel() for axis in figure.axes), "below each column"
    assert [axis.get_title() for axis in figure.axes][:2] == [r"swing: $\omega_{0}$", r"double swing: $\omega_{1}$"]


def test_dots_of_a_method_without_finite_values(tmp_path):
    metrics = write_metrics(tmp_path)
    table = pd.read_csv(metrics[0])
    table["value"] = np.inf
    table.to_csv(metrics[0], index=False)
    figure = dots.log_mse(rows_of(tables_of(metrics)), PlotJob(labels=[]))
    assert sum(text.get_text() == "not finite" for text in figure.axes[0].texts) == 3
    assert_nothing_is_cut(figure)


def test_same_numbers_make_the_same_files(tmp_path):
    rows = rows_of(tables_of(write_metrics(tmp_path, labels=LABELS[-2:])))
    for name in ("a", "b"):
        plotting.save_all({tmp_path / name: dots.log_mse(rows, PlotJob(labels=[]))})
    for suffix in (".png", ".pdf"):
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_overview(tmp_path, drawn):
    def marks(axis):
        return sum(not line.get_label().startswith("_") for line in axis.lines)

    metrics = write_metrics(tmp_path) + write_metrics(tmp_path, "double_swing")
    swing = OverviewExperiment(name="swing", shown=True, shifted="test", opponents=["mean"])
    double = OverviewExperiment(
        name="double_swing", shown=True, shifted=None, convention="dim", title="two swings", opponents=[]
    )
    job = OverviewJob(experiments=[swing, double], hues=[("mean", 0), ("hybrid", 1)])
    overview(tables_of(metrics), tmp_path / "figures", job)
    names = {f"{name}.{end}" for name in ("log_mse", "parameter_errors", "za_shifted") for end in ("png", "pdf")}
    assert {path.name for path in (tmp_path / "figures").iterdir()} == names
    left, right = drawn[0].axes
    assert left.get_xlabel() == right.get_xlabel() == "log-MSE (lower is better)"
    assert (marks(left), marks(right)) == (6, 4), "two sets, Hybrid and Hybrid+; on the left Mean beside them"
    assert left.get_title().startswith("swing (summed") and right.get_title().startswith("two swings (averaged")
    assert len(drawn[2].axes) == 1 and marks(drawn[2].axes[0]) == 3
    assert not drawn[2].legends, "of one set"
