"""Published numbers and verdicts."""

from __future__ import annotations

import math

import pandas as pd
import pytest

from expertaug.errors import InputError
from expertaug.evaluation.published import Published, compare, published_numbers, verdict

LABELS = ("APHYNITY", "HVAE", "APHYNITY+", "HVAE+")


def number(mean, std, decimals=1):
    return Published("t", "s", "A", "test", "log_mse_sum", mean, std, 10, decimals)


def test_the_paper_has_24_cells_in_each_table():
    numbers = published_numbers()
    cells = {(n.system, n.label, n.set, n.metric) for n in numbers}
    assert len(cells) == len(numbers) == 48
    assert {n.label for n in numbers} == set(LABELS) and {n.n for n in numbers} == {10}
    found = {(n.system, n.label, n.set, n.metric): (n.mean, n.std) for n in numbers}
    assert found["rlc", "HVAE+", "validation", "log_mse_sum"] == (-3.8, 1.5)
    assert found["reaction_diffusion", "APHYNITY", "test", "log_mse_sum"] == (1.0, 0.4)
    assert found["pendulum", "HVAE", "test", "relative_error"] == (117, 10)


@pytest.mark.parametrize(
    ("mean", "expected"),
    [(-3.3, "within"), (-2.99, "worse"), (-3.0, "within"), (-3.61, "better"), (math.nan, "worse")],
)
def test_verdicts(mean, expected):
    assert verdict(number(-3.3, 0.3), mean) == expected


def test_a_deviation_printed_as_zero_may_be_half_a_unit():
    assert [verdict(number(2, 0, 0), mean) for mean in (1.4, 2.4, 2.6)] == ["better", "within", "worse"]


@pytest.fixture
def metrics(tmp_path):
    """Two experiments of one system, the first without HVAE."""
    paths = []
    for experiment, labels, shift in (("swing", LABELS[::2], 0.0), ("other", LABELS, 2.0)):
        rows = [
            (experiment, "pendulum", label.lower(), label, "corrected", seed, name, metric, value + shift + 0.1 * seed)
            for label in labels
            for name in ("validation", "test")
            for metric, value in (("log_mse_sum", -3.3), ("relative_error", 6.0))
            for seed in (0, 1)
        ]
        paths.append(tmp_path / f"{experiment}.csv")
        columns = ["experiment", "system", "method", "label", "preset", "seed", "set", "metric", "value"]
        pd.DataFrame(rows, columns=columns).to_csv(paths[-1], index=False)
    return paths


def test_tables(metrics, tmp_path):
    outputs = [tmp_path / f"t.{end}" for end in ("csv", "md", "tex")]
    compare(metrics, outputs, {"published": [["swing", "pendulum"], ["other", "pendulum"]]})
    table = pd.read_csv(outputs[0])
    assert len(table) == 32
    row = table.set_index(["experiment", "label", "set", "metric"])
    cell = row.loc[("swing", "APHYNITY+", "test", "log_mse_sum")]
    assert (cell["mean"], cell["n"], cell["verdict"]) == (pytest.approx(-3.25), 2, "within")
    assert row.loc[("swing", "APHYNITY", "test", "log_mse_sum"), "verdict"] == "better"
    assert row.loc[("other", "APHYNITY+", "test", "log_mse_sum"), "verdict"] == "worse"
    assert row.loc[("swing", "HVAE", "test", "log_mse_sum"), "verdict"] == "not run"
    text = outputs[1].read_text()
    assert "| swing | test (OOD) | APHYNITY+ | −3.3 ± 0.3 | −3.25 ± 0.07 | 2 | within |" in text
    assert "| swing | validation (IID) | HVAE | −2.9 ± 0.5 | – | 0 | not run |" in text
    assert "swing: corrected" in text
    good = table.query("metric == 'log_mse_sum' and verdict in ('within', 'better')")
    assert f"{len(good)} of 12." in text
    tex = outputs[2].read_text()
    assert r"\label{tab:synth_log_mse}" in tex and r"\label{tab:param_acc}" in tex
    assert tex.isascii() and tex.count("{") == tex.count("}")


def test_unknown_systems_are_named(metrics, tmp_path):
    with pytest.raises(InputError, match="no system 'swing'; known: pendulum"):
        compare(metrics, [tmp_path / "t.csv"], {"published": [["swing", "swing"]]})
    with pytest.raises(InputError, match=r"one of \.csv"):
        compare(metrics, [tmp_path / "t.xls"], {"published": [["swing", "pendulum"]]})
