"""Trajectories of tables: in the units of the system, told apart, in order of time and each time once."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from swings import NAMES, settings, swing, table

from expertaug.errors import InputError
from expertaug.measurements.cut import all_chunks, measure
from expertaug.measurements.settings import Column
from expertaug.measurements.trajectory import read


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


def test_a_formula_calibrates_a_column_before_its_factor(tmp_path):
    y = swing(1.0)
    path = table(tmp_path / "a.csv", {"t": 0.05 * np.arange(200), "volts": 2.5 * np.sin(y[:, 0]) + 0.1})
    column = Column(name="volts", formula="arcsin((x - 0.1) / 2.5)", factor=-1.0)
    given = settings(path, trajectory=None, columns={"theta": column})
    (rows,) = read([path], given, NAMES)
    assert np.allclose(rows.y[:, 0], -y[:, 0], atol=1e-6)
    wrong = column.model_copy(update={"formula": "arcsin(x)"})
    with pytest.raises(InputError, match=r"'arcsin\(x\)' is not defined at 2\.\d+ \(row 2 of column 'volts'\)"):
        read([path], settings(path, trajectory=None, columns={"theta": wrong}), NAMES)


def test_a_unit_in_the_header_is_not_that_of_a_formula_s_values(tmp_path):
    path = table(tmp_path / "a.csv", {"t": 0.05 * np.arange(200), "volts [V]": swing(1.0)[:, 0] / 3})
    with pytest.raises(InputError, match=r"columns\.theta\.unit: missing: column 'volts \[V\]' tells V"):
        read([path], settings(path, trajectory=None, columns={"theta": "volts [V]"}), NAMES)
    column = Column(name="volts [V]", formula="180 / pi * 3 * x", unit="deg")
    (rows,) = read([path], settings(path, trajectory=None, columns={"theta": column}), NAMES)
    assert np.allclose(rows.y[:, 0], swing(1.0)[:, 0], atol=1e-6)


def test_dates_are_times(tmp_path):
    times = pd.date_range("2024-05-31T12:00:00", periods=50, freq="250ms")
    path = table(tmp_path / "a.csv", {"when": [t.isoformat() for t in times], "angle": swing(1.0)[:50, 0]})
    given = settings(path, trajectory=None, time=Column(name="when", unit="datetime"), columns={"theta": "angle"})
    assert measure(given, NAMES).grid.row_s == 0.25


def test_each_trajectory_has_its_rows_in_order_and_each_time_once(tmp_path):
    rows = {"trial": [1, 0, 0, 1, 0], "t": [0.1, 0.0, 0.2, 0.0, 0.2], "angle": [1, 3, 2, 4, 4]}
    path = table(tmp_path / "lab.csv", rows)
    given = settings(path, columns={"theta": "angle"}, unordered="sort", duplicates="mean")
    one, other = read([path], given, NAMES)
    assert (one.name, one.t.tolist(), one.y[:, 0].tolist(), one.line.tolist()) == ("lab/1", [0, 0.1], [4, 1], [5, 2])
    assert (other.name, other.t.tolist(), other.y[:, 0].tolist()) == ("lab/0", [0, 0.2], [3, 3])
    assert (one.repeated, other.repeated) == (0, 1) and np.isnan(one.y[:, 1]).all()
    with pytest.raises(InputError, match=r"columns.phi: 'phi' is no component of the state; known: theta, omega"):
        read([path], settings(path, columns={"phi": "angle"}), NAMES)
