"""What the columns of a table seem to be: by their names, their units and their numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from swings import NAMES

from expertaug.errors import InputError
from expertaug.measurements.guess import guess
from expertaug.measurements.settings import Column
from expertaug.measurements.table import Table

ROWS = np.arange(60)
COLUMNS = {
    "note": ["ok"] * 60,
    "gyro [deg/s]": -90 * np.sin(ROWS / 5),
    "mass": np.repeat([1.0, 2.0, 3.0], 20),
    "run": ROWS // 20,
    "time [ms]": 50 * (ROWS % 20),
    "phi [deg]": 30 * np.cos(ROWS / 5),
}


def seen(columns):
    cells = {name: np.array([str(value) for value in values], dtype=object) for name, values in columns.items()}
    return Table(Path("a.csv"), cells, np.arange(2, 2 + len(next(iter(cells.values())))))


def test_each_column_is_what_its_name_its_unit_and_its_numbers_say():
    found = guess(seen(COLUMNS), NAMES)
    assert found.time == Column(name="time [ms]", unit="ms") and found.trajectory == "run"
    assert found.columns == {
        "theta": Column(name="phi [deg]", unit="deg"),
        "omega": Column(name="gyro [deg/s]", unit="deg/s"),
    }
    assert found.certain == {"theta", "omega"}
    assert found.left == found.still == ["mass"] and found.unread == ["note"]


def test_without_a_system_each_further_column_of_numbers_is_a_component():
    found = guess(seen(COLUMNS), None)
    assert list(found.columns) == ["gyro_deg_s", "mass", "phi_deg"] and found.columns["mass"] == Column(name="mass")


@pytest.mark.parametrize(
    ("columns", "known", "message"),
    [
        (COLUMNS, {"time": "tme"}, "--time: no column 'tme'; its columns are note, gyro"),
        (COLUMNS, {"units": {"phi": "deg"}}, "--unit: no column 'phi'"),
        (COLUMNS, {"units": {"phi [deg]": "mm"}}, r"--unit phi \[deg\]: 'mm' is a unit of length"),
        ({"a": [1, 1, 2], "b": [2, 1, 1]}, {}, "no column is called time, and none increases"),
    ],
)
def test_what_cannot_be_so_is_one_line(columns, known, message):
    with pytest.raises(InputError, match=message) as error:
        guess(seen(columns), NAMES, **known)
    assert "\n" not in str(error.value)
