"""Published numbers and verdicts."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
from fake_runs import write_samples

from expertaug.errors import InputError
from expertaug.evaluation.intervals import mean
from expertaug.evaluation.published import Published, difference_of, published_numbers, verdict
from expertaug.evaluation.published import run_stage as compare
from expertaug.evaluation.settings import CompareJob

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


def ours(level, of_seeds=0.1):
    """A statistic of four seeds, whose spread over samples is small."""
    rng = np.random.default_rng(0)
    values = level + of_seeds * np.array([[-1], [1], [-0.5], [0.5]]) + 0.02 * rng.normal(size=(4, 200))
    return mean(values, np.arange(200))


@pytest.mark.parametrize(
    ("level", "of_seeds", "expected"),
    [
        (-3.3, 0.1, "no clear difference"),
        (-3.9, 0.1, "better"),
        (-2.7, 0.1, "worse"),
        (-3.9, 1.0, "no clear difference"),  # our seeds are too different
    ],
)
def test_verdicts(level, of_seeds, expected):
    found = ours(level, of_seeds)
    assert verdict(level, difference_of(number(-3.3, 0.3), found)) == expected


def test_verdicts_without_a_finite_value():
    assert verdict(math.nan, None) == "worse"


def test_a_deviation_printed_as_zero_and_digits_that_are_not_printed_are_spread():
    found = [verdict(level, difference_of(number(2, 0, 0), ours(level, 0.01))) for level in (1.2, 1.7, 2.4, 2.9)]
    assert found == ["better", "no clear difference", "no clear difference", "worse"]


def write(tmp_path, experiment, labels, level, sets=("validation", "test"), seeds=(0, 1, 2, 3)):
    """Metrics and samples' errors of an experiment: log-MSE ``level`` and parameters 6 % off, with little spread."""
    rng, paths = np.random.default_rng(1), ([], [])
    for label in labels:
        errors = {name: np.exp(level + 0.05 * rng.normal(size=(len(seeds), 80))) for name in sets}
        wrong = {name: 0.06 + 0.001 * rng.normal(size=(len(seeds), 80)) for name in sets}
        rows = [
            (experiment, "pendulum", label.lower(), label, "corrected", seed, name, metric, value)
            for name in sets
            for metric, values in (
                ("log_mse_sum", np.log(errors[name].mean(1))),
                ("relative_error", 100 * wrong[name].mean(1)),
            )
            for seed, value in zip(seeds, values, strict=True)
        ]
        columns = ["experiment", "system", "method", "label", "preset", "seed", "set", "metric", "value"]
        paths[0].append(tmp_path / f"{experiment}_{label}.csv")
        pd.DataFrame(rows, columns=columns).to_csv(paths[0][-1], index=False)
        file = tmp_path / f"{experiment}_{label}.npz"
        paths[1].append(write_samples(file, label.lower(), seeds, errors, experiment, wrong=wrong))
    return paths


@pytest.fixture
def runs(tmp_path):
    """Metrics and forecasts of two experiments of one system, one without HVAE, the other with an IID test set."""
    one = write(tmp_path, "swing", LABELS[::2], -3.3)
    two = write(tmp_path, "other", LABELS, -1.2, ("validation", "iid", "test"))
    return [*one[0], *two[0]], [*one[1], *two[1]]


def test_tables(runs, tmp_path):
    outputs = [tmp_path / f"t.{end}" for end in ("csv", "md", "tex")]
    metrics, forecasts = runs
    compare(metrics, outputs, CompareJob(published=[["swing", "pendulum"], ["other", "pendulum"]]), forecasts)
    table = pd.read_csv(outputs[0])
    assert len(table) == 32
    row = table.set_index(["experiment", "label", "set", "metric"])
    cell = row.loc[("swing", "APHYNITY+", "test", "log_mse_sum")]  # published -3.3 +- .3
    assert (cell["mean"], cell["n"], cell["verdict"]) == (pytest.approx(-3.3, abs=0.02), 4, "no clear difference")
    assert cell["low"] < cell["mean"] < cell["high"] and cell["at_or_below"]
    assert row.loc[("swing", "APHYNITY", "test", "log_mse_sum"), "verdict"] == "better"  # -.9 +- .2
    assert row.loc[("other", "APHYNITY+", "test", "log_mse_sum"), "verdict"] == "worse"
    assert row.loc[("swing", "HVAE", "test", "log_mse_sum"), "verdict"] == "not run"
    text = outputs[1].read_text()
    assert "| swing | test (OOD) | APHYNITY+ | −3.3 ± 0.3 | −3.30 [−3." in text and "| 4 | 0." in text
    assert "| swing | validation (set of choices) | HVAE | −2.9 ± 0.5 | – | 0 | – | not run |" in text
    assert "swing: corrected" in text
    logs = table.query("metric == 'log_mse_sum' and verdict != 'not run'")
    below, counts = logs["at_or_below"].eq(True).sum(), logs["verdict"].value_counts()
    assert f"At or below the published mean plus one standard deviation: {below} of 12." in text
    better, apart, worse = (counts[name] for name in ("better", "no clear difference", "worse"))
    assert f"Of 12 cells {better} better, {apart} no clear difference, {worse} worse." in text
    tex = outputs[2].read_text()
    assert r"\label{tab:synth_log_mse}" in tex and r"\label{tab:param_acc}" in tex
    assert tex.isascii() and tex.count("{") == tex.count("}")


def test_the_papers_validation_set_is_compared_with_the_iid_test_set(runs, tmp_path):
    metrics, forecasts = runs
    output = tmp_path / "t.csv"
    compare(metrics, [output], CompareJob(published=[["swing", "pendulum"], ["other", "pendulum"]]), forecasts)
    sets = pd.read_csv(output).groupby("experiment")["set"].unique()
    assert sorted(sets["other"]) == ["iid", "test"] and sorted(sets["swing"]) == ["test", "validation"]


def test_errors_of_samples_are_needed(runs, tmp_path):
    metrics, forecasts = runs
    with pytest.raises(InputError, match=r"APHYNITY of swing: no errors of the samples"):
        compare(metrics, [tmp_path / "t.csv"], CompareJob(published=[["swing", "pendulum"]]), forecasts[1:])


def test_unknown_systems_are_named(runs, tmp_path):
    metrics, forecasts = runs
    with pytest.raises(InputError, match="no system 'swing'; known: pendulum"):
        compare(metrics, [tmp_path / "t.csv"], CompareJob(published=[["swing", "swing"]]), forecasts)
    with pytest.raises(InputError, match=r"one of \.csv"):
        compare(metrics, [tmp_path / "t.xls"], CompareJob(published=[["swing", "pendulum"]]), forecasts)
