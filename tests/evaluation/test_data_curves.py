"""Errors of several experiments against the number of their trajectories, and their noise."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd
import pytest

from expertaug.errors import InputError
from expertaug.evaluation.data_curves import data_curves, run_stage
from expertaug.evaluation.settings import DataCurvesJob
from expertaug.evaluation.summary import TabledMean
from expertaug.hues import EQUATION
from expertaug.rows import frame

LABELS = {"fit": "Fit", "hybrid": "Hybrid", "hybrid=": "Hybrid=", "floor": "Floor"}
LEVELS = {"few": -2.0, "many": -5.0, "clean": -9.0}


def long(experiment, **changed):
    """Rows of the long table of an experiment: methods are a nat apart, sets .1; no parameters of the floor."""
    rows = []
    for k, (method, label) in enumerate(LABELS.items()):
        for s, name in enumerate(("train", "validation", "iid", "test")):
            level = LEVELS[experiment] - k + 0.1 * s
            values = {"log_mse_sum": level, "log_mse_dim": level - 0.7}
            values |= {} if method == "floor" else {"relative_error": 7.0}
            told = {"experiment": experiment, "system": "p", "preset": "corrected", "method": method, "label": label}
            for metric, mean in values.items():
                spread = {"mean": mean, "std": 0.2, "n": 2, "of": 2, "low": mean - 0.3, "high": mean + 0.5}
                rows.append(TabledMean(metric=metric, set=name, seeds=(0, 1), **told, **spread | changed))
    return rows


def table_of(folder, experiment):
    """The long table of an experiment."""
    path = folder / f"{experiment}_long.csv"
    frame(TabledMean, long(experiment)).to_csv(path, index=False)
    return path


def asked(axes, labels):
    return DataCurvesJob(experiment="many", axes=list(axes.items()), labels=list(labels.items()), floor="floor")


def job(**axes):
    points = {"samples": [(20, "few"), (1000, "many")], "noise": [(0.0, "clean"), (0.01, "many")]}
    return asked(points | axes, LABELS)


def test_a_row_is_a_point_and_a_method_and_a_line_its_intervals(tmp_path, drawn):
    tables = [table_of(tmp_path, name) for name in LEVELS]
    outputs = [tmp_path / f"curves.{end}" for end in ("csv", "md", "tex", "png")]
    run_stage(tables, outputs, job())
    text = (tmp_path / "curves.md").read_text()
    assert "| training trajectories | 20 | 1000 |" in text and "| standard deviation of the noise | 0 | 0.01 |" in text
    assert "| Fit | −1.80 [−2.10, −1.30] | −4.80 [−5.10, −4.30] |" in text and "| Fit | 7.0 [6.7, 7.5] |" in text
    assert text.count("| Floor |") == 4 and text.count("| Fit |") == 8
    assert (tmp_path / "curves.tex").read_text().isascii()
    csv = pd.read_csv(tmp_path / "curves.csv")
    assert set(csv["set"]) == {"iid", "test"} and set(csv["along"]) == {"samples", "noise"}
    assert set(csv["metric"]) == {"log_mse_sum", "relative_error"} and len(csv) == 4 * 2 * (4 + 3)
    (figure,) = drawn
    assert [axis.get_xlabel().split()[0] for axis in figure.axes] == ["training"] * 2 + ["standard"] * 2
    assert figure.axes[2].get_xlabel().endswith("[the component's unit]")
    assert figure.get_suptitle() == "many: how errors depend on the data"
    assert [axis.get_title() for axis in figure.axes] == ["IID test", "test (OOD)", "", ""]
    iid = figure.axes[0]
    assert [tick.get_text() for tick in iid.get_xticklabels()] == ["20", "1000"]
    lines = {bars.get_label(): bars for bars in iid.containers}
    assert set(lines) == {"Fit", "Hybrid", "Floor"}  # no control
    assert lines["Floor"].lines[0].get_linestyle() == ":" and lines["Floor"].lines[0].get_color() == EQUATION
    assert list(lines["Hybrid"].lines[0].get_ydata()) == pytest.approx([-2.8, -5.8])
    bar = lines["Hybrid"].lines[2][0].get_segments()[0][:, 1]
    assert list(bar) == pytest.approx([-3.1, -2.3])


def test_a_point_without_a_table_is_refused():
    with pytest.raises(InputError, match="clean: no table of this experiment"):
        data_curves([*long("few"), *long("many")], job())


def test_without_intervals_and_finite_values_nothing_is_drawn_of_a_point():
    nan = float("nan")
    rows = [*long("few", mean=nan, n=0), *long("many", low=nan, high=nan)]
    study = data_curves(rows, job(noise=[(0.01, "many")]))
    text = study.markdown()
    assert "not finite (0/2)" in text and "± 0.20" in text
    line = next(bars for bars in study.figure().axes[0].containers if bars.get_label() == "Fit")
    assert len(line.lines[0].get_ydata()) == 1


def test_a_panel_has_seven_lines_with_the_floor():
    rows = long("many")
    fits = [row for row in rows if row.method == "fit"]
    rows += [replace(row, method=f"m{k}", label=f"M{k}") for k in range(9) for row in fits]
    labels = LABELS | {f"m{k}": f"M{k}" for k in range(9)}
    study = data_curves(rows, asked({"samples": [(1000, "many")]}, labels))
    assert [len(axis.containers) for axis in study.figure().axes] == [7, 7]
