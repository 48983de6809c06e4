"""Tables that were altered by hand or by a disk: one line that names row and column."""

import pytest

from expertaug.errors import InputError
from expertaug_recordings.tables import read_table

SOUND = ["frame,t,x,reason", "0,0.0,1.5,", "1,0.1,,lost:tip", "2,0.2,2,"]


def read(path, lines):
    path.write_text("\n".join(lines))
    return read_table(path, ("frame", "t", "x"), ("reason",), "track_markers")


def test_numbers_and_texts(tmp_path):
    table = read(tmp_path / "a.csv", SOUND)
    assert table["frame"].tolist() == [0, 1, 2] and table["reason"].tolist() == ["", "lost:tip", ""]
    assert table["x"].isna().tolist() == [False, True, False] and table["x"].dtype == float


@pytest.mark.parametrize(
    ("row", "line", "message"),
    [
        (2, "1,0.1,here,", "row 3, column x: 'here' is no number"),
        (2, "1,0.1,inf,", "row 3, column x: 'inf' is out of range"),
        (2, "1,0.1,-1e308,", r"row 3, column x: '-1e\+308' is out of range"),
        (2, "1,,2,", "row 3, column t: '' is no number"),
        (1, "0.5,0,2,", "row 2, column frame: '0.5' is no frame's number"),
        (3, "99999999999999999999,0,2,", "row 4, column frame: '.*' is out of range"),
        (0, "frame,t,y,reason", "column x is missing; expected frame,t,x,reason"),
        (2, '1,"', "not a table"),
    ],
)
def test_what_is_no_number_is_named(tmp_path, row, line, message):
    with pytest.raises(InputError, match=message) as error:
        read(tmp_path / "a.csv", [*SOUND[:row], line, *SOUND[row + 1 :]])
    assert "\n" not in str(error.value)


def test_a_header_alone_is_a_table_without_rows(tmp_path):
    assert len(read(tmp_path / "a.csv", SOUND[:1])) == 0


def test_files_that_are_no_tables(tmp_path):
    with pytest.raises(InputError, match="no such file; run measure_angles"):
        read_table(tmp_path / "none.csv", ("t",))
    for name, content in (("empty", b""), ("binary", b"\xff\xfe\x00\x00")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=r"not a table .*; run measure_angles again"):
            read_table(tmp_path / name, ("t",))
    with pytest.raises(InputError, match="not a table"):
        read_table(tmp_path, ("t",))
