"""Columns of a table: numbers as people write them, and what is refused of a cell."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug.errors import InputError
from expertaug.measurements.settings import TableKeys
from expertaug.measurements.table import Table
from expertaug.measurements.table_files import read_table


def test_a_column_is_of_texts_or_of_numbers(tmp_path):
    cells = {"run": np.array(["a", "a", "b"], dtype=object), "x": np.array([1.0, np.nan, 3.0])}
    table = Table(tmp_path / "a.csv", cells, np.arange(2, 5))
    assert table.names == ["run", "x"] and len(table) == 3 and table.mostly("run") is None
    assert table.kinds("run").texts == ["a", "b"] and table.kinds("run").of_row.tolist() == [0, 0, 1]
    assert table.measured("x")[[0, 2]].tolist() == [1.0, 3.0] and np.isnan(table.measured("x")[1])
    with pytest.raises(InputError, match=r"no column 'y'"):
        table.numbers("y")


def test_minus_signs_and_exponents_as_others_write_them(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("t,x,y\n0,\N{MINUS SIGN}1.5,1.25D-03\n1,2,\N{MINUS SIGN}.5d2\n2,-1,3\n", encoding="utf-8")
    read = read_table(path, TableKeys())
    assert read.numbers("x").tolist() == [-1.5, 2, -1] and read.numbers("y").tolist() == [0.00125, -50, 3]
    path.write_text("t,x\n0,1\n1,d2\n")
    with pytest.raises(InputError, match="'d2' is no number"):
        read_table(path, TableKeys()).numbers("x")
