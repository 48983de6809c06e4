"""Rows of tables: what is written is read, columns follow from the fields, and what cannot be read is one line."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pandas as pd
import pytest

from expertaug.errors import InputError
from expertaug.rows import cells, columns, frame, group_by, read_csv, write_csv


@dataclass(frozen=True)
class Ends:
    mean: float
    low: float


@dataclass(frozen=True)
class Row:
    name: str
    seeds: tuple[int, ...]
    value: float
    told: bool | None
    gain: Ends | None = None
    epoch: int | None = None


ROWS = [Row("a, b", (0, 1), 1 / 3, True), Row("", (), math.nan, None, Ends(0.5, -1e-300))]


def test_columns_follow_from_the_fields():
    assert [column.name for column in columns(Row)] == ["name", "seeds", "value", "told", "gain", "gain_low", "epoch"]
    assert list(cells(Row, ROWS)) == ["name", "seeds", "value", "told", "gain", "gain_low"], "no row has passes"
    assert list(cells(Row, ROWS[:1])) == list(cells(Row, [])) == ["name", "seeds", "value", "told"]


def test_what_is_written_is_read(tmp_path):
    write_csv(tmp_path / "rows.csv", Row, ROWS)
    first, second = read_csv(tmp_path / "rows.csv", Row, "again")
    assert first == ROWS[0]
    assert (second.name, second.seeds, second.told, second.gain) == ("", (), None, ROWS[1].gain)
    assert math.isnan(second.value) and second.epoch is None


def test_pandas_writes_the_same(tmp_path):
    write_csv(tmp_path / "rows.csv", Row, ROWS)
    assert (tmp_path / "rows.csv").read_text() == frame(Row, ROWS).to_csv(index=False)
    assert isinstance(frame(Row, []), pd.DataFrame)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no rows"),
        ("name,seeds,told\na,0,True\n", "line 2 has no 'value'"),
        ("name,seeds,value,told\na,0,1.5,True\nb,0,high,True\n", "line 3: value is 'high'"),
        ("name,seeds,value,told\na,x,1.5,True\n", "line 2: seeds is 'x'"),
        ("name,seeds,value,told\na,0,1.5,yes\n", "line 2: told is 'yes'"),
        ("name,seeds,value,told,gain,gain_low\na,0,1.5,True,1.0,low\n", "line 2: gain_low is 'low'"),
        (b"\xff\xfe", "cannot be read"),
    ],
)
def test_what_cannot_be_read_is_refused(tmp_path, text, message):
    path = tmp_path / "rows.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=f"rows.csv: .*{message}"):
        read_csv(path, Row, "again")
    with pytest.raises(InputError, match="cannot be read"):
        read_csv(tmp_path / "none.csv", Row, "again")


def test_groups_are_in_order_of_appearance():
    assert group_by([3, 1, 4, 1, 5], lambda n: n % 2) == {1: [3, 1, 1, 5], 0: [4]}
