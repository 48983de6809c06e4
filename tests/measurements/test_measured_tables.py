"""Tables in, numbers out: formats, separators, units and expressions."""

import numpy as np
import pandas as pd
import pytest
from swings import NAMES, settings, swing, table, trials

from expertaug.errors import InputError
from expertaug.measurements import expression
from expertaug.measurements.cut import all_chunks, measure
from expertaug.measurements.paths import list_files
from expertaug.measurements.settings import Column, TableKeys
from expertaug.measurements.table import read_table
from expertaug.measurements.units import conversion


@pytest.mark.parametrize("separator", [",", ";", "\t", "|", " "])
def test_any_common_separator_gives_the_same_numbers(tmp_path, separator):
    y = swing(1.0)
    path = table(tmp_path / "a.csv", {"t": 0.05 * np.arange(200), "angle": y[:, 0]}, separator, "# from a lab\n\n")
    found = read_table(path, TableKeys())
    assert found.names == ["t", "angle"] and np.array_equal(found.numbers("angle"), y[:, 0])
    assert found.line[0] == 4 and found.line[-1] == 203  # as an editor counts


def test_commas_as_decimals_units_row_and_other_encodings(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes("t;Höhe\ns;mm\n0,0;1,5\n0,1;\n".encode("latin-1"))
    found = read_table(path, TableKeys(decimal=","))
    assert found.numbers("Höhe")[0] == 1.5 and np.isnan(found.numbers("Höhe")[1])
    assert found.units == {"t": "s", "Höhe": "mm"}
    path.write_text("t,x\n0,1\n", encoding="utf-16")
    assert read_table(path, TableKeys()).numbers("x").tolist() == [1.0]


def test_parquet_npz_and_csv_give_the_same_chunks(tmp_path):
    path = trials(tmp_path)
    frame = pd.read_csv(path)
    frame.to_parquet(tmp_path / "swings.parquet")
    np.savez(tmp_path / "swings.npz", **{name: frame[name].to_numpy() for name in frame})
    found = [all_chunks(measure(settings(tmp_path / f"swings.{end}"), NAMES)) for end in ("csv", "parquet", "npz")]
    for other in found[1:]:
        assert np.array_equal(found[0].y, other.y) and np.array_equal(found[0].t, other.t)


KINDS = (
    "rad mrad deg gon rev",
    "rad/s deg/s rpm rev/s dps",
    "s ms us ns min h d week",
    "1/s 1/min 1/h 1/d Hz kHz",
    "m km cm mm um in ft",
    "m/s cm/s mm/s km/h",
    "m/s2 mm/s2 g0",
    "V kV mV uV",
    "A mA uA",
    "ohm kohm Mohm",
    "F mF uF nF pF",
    "H mH uH",
    "kg g mg",
    "N kN mN",
    "Pa kPa hPa bar mbar",
    "K degC degF",
    "1 % 1000",
)


def test_units_go_both_ways():
    for units in map(str.split, KINDS):
        for one in units:
            for other in units:
                (a, b), (c, d) = conversion(one, other, ""), conversion(other, one, "")
                assert (3.7 * a + b) * c + d == pytest.approx(3.7, abs=1e-9)
    assert conversion("°C", "K", "") == (1.0, 273.15)
    assert conversion("rpm", "rad/s", "")[0] == pytest.approx(2 * np.pi / 60)
    assert conversion(None, "anything", "") == conversion("same", "same", "") == (1.0, 0.0)


@pytest.mark.parametrize(
    ("unit", "to", "message"),
    [("mm", "rad", "a unit of length, the system has rad"), ("furlong", "m", "not known; units of length: m, km")],
)
def test_units_that_do_not_fit_are_refused(unit, to, message):
    with pytest.raises(InputError, match=message):
        conversion(unit, to, "data.files.columns.x.unit")


def test_columns_are_converted_to_the_system_s_units(tmp_path):
    y = swing(1.0)
    rows = {"ms": 50.0 * np.arange(200), "deg": np.degrees(y[:, 0]) + 5.0, "rpm": -y[:, 1] * 30 / np.pi}
    path = table(tmp_path / "a.csv", rows)
    columns = {
        "theta": Column(name="deg", unit="deg", offset=-5.0),
        "omega": Column(name="rpm", unit="rpm", factor=-1.0),
    }
    given = settings(path, trajectory=None, time=Column(name="ms", unit="ms"), columns=columns)
    chunk = all_chunks(measure(given, NAMES))
    assert np.allclose(chunk.y[0], y[:20], atol=1e-6) and chunk.t[1] == pytest.approx(0.05)


def test_dates_are_times(tmp_path):
    times = pd.date_range("2024-05-31T12:00:00", periods=50, freq="250ms")
    path = table(tmp_path / "a.csv", {"when": [t.isoformat() for t in times], "angle": swing(1.0)[:50, 0]})
    given = settings(path, trajectory=None, time=Column(name="when", unit="datetime"), columns={"theta": "angle"})
    assert measure(given, NAMES).grid.row_s == 0.25


def test_files_are_in_natural_order_and_named_shortly(tmp_path):
    for name in ("b/run10.csv", "b/run2.csv", "a/run2.csv"):
        table(tmp_path / name, {"t": 0.05 * np.arange(30), "angle": swing(1.0)[:30, 0]})
    files = list_files([f"{tmp_path}/b/*.csv", f"{tmp_path}/**/run2.csv"])
    assert [str(file.relative_to(tmp_path)) for file in files] == ["a/run2.csv", "b/run2.csv", "b/run10.csv"]
    given = settings([str(file) for file in files], trajectory=None, columns={"theta": "angle"})
    assert [one.name for one in measure(given, NAMES).grid.series] == ["a/run2", "b/run2", "b/run10"]


def test_expressions_are_arithmetic_and_nothing_else():
    columns = {"theta": np.array([0.0, 1.0, np.nan]), "omega": np.array([2.0, 0.0, 1.0])}
    found = expression.value("omega**2 / 2 - 1.5 * cos(theta) + 0 * pi", columns, "")
    assert found[:2] == pytest.approx([0.5, -1.5 * np.cos(1.0)]) and np.isnan(found[2])
    assert np.isnan(expression.value("log(theta - 1)", columns, "")).all()
    assert expression.names("maximum(abs(theta), omega)", "") == ["theta", "omega"]
    for text in (
        "__import__('os').system('true')",
        "theta.__class__",
        "[x for x in theta]",
        "open(theta)",
        "theta if omega else 1",
        "lambda: theta",
        "theta[0]",
        "'a' * 3",
        "cos()",
        "theta +",
        "theta" * 200,
        "theta * 1" + 400 * "0",
        "theta * 1e400",
    ):
        with pytest.raises(InputError) as error:
            expression.names(text, "data.files.split.quantity")
        assert "\n" not in str(error.value)
    with pytest.raises(InputError, match="names 'speed'; known: theta, omega"):
        expression.value("speed", columns, "")
