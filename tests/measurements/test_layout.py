"""How a table is laid out is found from the file: thousands, lines above it, long formats."""

from __future__ import annotations

import numpy as np
import pytest
from logger_tables import T, Y, csv, rows_of
from swings import NAMES

from expertaug.errors import InputError
from expertaug.measurements.cut import measure
from expertaug.measurements.layout import recognise
from expertaug.measurements.settings import MeasurementSettings, TableKeys
from expertaug.measurements.table_files import read_table


@pytest.mark.parametrize(
    ("numbers", "keys"),
    [
        (
            lambda v: f"{v:,.1f}".replace(",", " ").replace(".", ",").replace(" ", "."),
            {"thousands": ".", "decimal": ","},
        ),
        (lambda v: f"{v:,.1f}", {"thousands": ","}),
        (lambda v: f"{v:,.0f}".replace(",", "."), {"thousands": ".", "decimal": ","}),
        (lambda v: f"{v:,.2f}".replace(",", "'"), {"thousands": "'"}),
        (lambda v: f"{v:,.1f}".replace(",", "\u202f").replace(".", ","), {"thousands": "\u202f", "decimal": ","}),
        (lambda v: f"{v:,.1f}".replace(",", "\u00a0"), {"thousands": "\u00a0"}),
    ],
    ids=["1.234,5", "1,234.5", "1.234", "1'234.50", "narrow blank", "blank that keeps a line together"],
)
def test_thousands_are_recognised(inspected, numbers, keys):
    lines = ["t;theta;omega", *(f"{k};{numbers(3000 * a)};{numbers(3000 * b)}" for k, (a, b) in enumerate(Y))]
    told, data = inspected("\n".join(lines) + "\n")
    found = {key: data["files"].get(key, ".") for key in ("thousands", "decimal")}
    assert found == {"decimal": "."} | keys and "separates thousands" in told
    np.testing.assert_allclose(rows_of(data).y, 3000 * Y, atol=0.51)


def test_fractions_of_three_digits_are_fractions(inspected):
    for form in ("{:.3f}", "{:.4g}"):
        assert "thousands" not in inspected(csv(form=form))[1]["files"]


PREAMBLES = {
    "words": "Device: logger 7\nSerial 1234\nStart: 2021-03-28 10:00\n\n",
    "pairs": "Writer,2\nSeparator,Comma\nDate,2021/03/28\n***End***\n\nChannels,2,\nSamples,400,400,\n",
    "one word": "Measurement\n",
    "a name above empty cells": "mass A,,\n",
}


@pytest.mark.parametrize("above", PREAMBLES)
@pytest.mark.parametrize("units", ["", "s,rad,rad/s\n"])
def test_lines_of_a_logger_above_the_table_are_skipped(inspected, above, units, tmp_path):
    header, _, rows = csv().partition("\n")
    text = f"{PREAMBLES[above]}{header}\n{units}{rows}"
    told, data = inspected(text)
    assert data["files"]["skip_lines"] == PREAMBLES[above].count("\n") and "lines above the table" in told
    np.testing.assert_allclose(rows_of(data).y, Y, atol=1e-5)
    if above in ("words", "pairs"):
        with pytest.raises(InputError, match=f"skip_lines to {PREAMBLES[above].count(chr(10))}"):
            read_table(tmp_path / "a.csv", TableKeys())


def test_what_a_spreadsheet_leaves_at_the_right_and_below_is_nothing(inspected):
    text = "\n".join(f"{line},,," for line in csv().splitlines()) + "\n,,,,,\n,,,,,\n"
    told, data = inspected(text)
    assert "400 rows" in told and "not read" not in told and list(data["files"]["columns"]) == ["theta", "omega"]


LONG = [
    "sensor,t,value",
    *(f"{n},{t:.2f},{v:.5f}" for k, n in enumerate(("theta", "omega")) for t, v in zip(T, Y[:, k], strict=True)),
]


@pytest.mark.parametrize("order", ["by sensor", "by time"])
def test_long_tables_are_pivoted(inspected, order):
    rows = LONG[1:] if order == "by sensor" else sorted(LONG[1:], key=lambda row: float(row.split(",")[1]))
    told, data = inspected("\n".join([LONG[0], *rows]) + "\n")
    assert data["files"]["pivot"] == {"name": "sensor", "value": "value"} and "long format" in told
    np.testing.assert_allclose(rows_of(data).y, Y, atol=1e-5)


BESIDE = {
    "Vernier": ("Run {}: Time (s)", "Run {}: Angle (rad)", "Run {}: Velocity (rad/s)"),
    "PASCO": ("Time (s) Run #{}", "Angle (rad) Run #{}", "Velocity (rad/s) Run #{}"),
    "numbers": ("t{}", "theta{}", "omega{}"),
}


@pytest.mark.parametrize("names", BESIDE.values(), ids=BESIDE)
def test_runs_beside_each_other_are_refused(inspected, names):
    header = ",".join(name.format(run) for run in (1, 2) for name in names)
    rows = [f"{t:.2f},{a:.5f},{b:.5f},{t:.2f},{2 * a:.5f},{2 * b:.5f}" for t, (a, b) in zip(T, Y, strict=True)]
    told, _ = inspected("\n".join([header, *rows]) + "\n", status=2)
    assert "2 runs beside each other, with times" in told and "save a file for each" in told


def test_two_bodies_are_not_two_runs(inspected):
    rows = [f"{t:.2f},{a:.5f},{b:.5f},{2 * a:.5f}" for t, (a, b) in zip(T, Y, strict=True)]
    _, data = inspected("\n".join(["time,theta,omega,theta2", *rows]) + "\n")
    assert data["files"]["columns"].keys() == {"theta", "omega"}


def test_seconds_beside_milliseconds_are_no_trajectories(inspected):
    rows = [f"{int(t)},{round(1000 * (t % 1)) % 1000},{a:.5f},{b:.5f}" for t, (a, b) in zip(T, Y, strict=True)]
    told, _ = inspected("\n".join(["s,ms,theta,omega", *rows]) + "\n", status=2)
    assert "'s' and 'ms' are parts of the time" in told


def test_long_tables_of_several_trajectories_units_and_rates(inspected):
    rows = [
        f"{run};{t:.2f};{name};{180 / np.pi * v:.5f};{unit};{k % 3}"
        for run in range(3)
        for k, (t, both) in enumerate(zip(T, Y, strict=True))
        for name, unit, v in zip(("angle", "speed"), ("deg", "deg/s"), both, strict=True)
        if name == "angle" or k % 2 == 0
    ]
    _, data = inspected("\n".join(["run;time [s];channel;reading;unit;quality", *rows]) + "\n")
    assert data["files"]["pivot"]["unit"] == "unit"
    assert data["files"]["columns"]["theta"] == {"name": "angle", "unit": "deg"}
    grid = measure(MeasurementSettings.from_mapping(data["files"]), NAMES).grid
    assert len(grid.series) == 3
    np.testing.assert_allclose(grid.series[1].rows.y[:, 0], Y[:, 0], atol=1e-5)
    assert np.isnan(grid.series[1].rows.y[1::2, 1]).all()


def test_a_file_of_numbers_alone_gets_names_and_its_commas_are_found(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("0,0;1,5\n0,1;2,5\n0,2;3,5\n")
    found = recognise(path)
    assert found.keys == {"names": ["c1", "c2"], "decimal": ","} and not found.remarks
    assert found.table.numbers("c2").tolist() == [1.5, 2.5, 3.5]
    assert recognise(path, {"names": ["t", "x"]}).table.names == ["t", "x"]
