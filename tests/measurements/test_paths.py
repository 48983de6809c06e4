"""Files of measurements: in natural order, each once, and those that their checksums say."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from swings import NAMES, settings, swing, table

from expertaug.errors import InputError
from expertaug.measurements.cut import measure
from expertaug.measurements.paths import list_files, verify


def test_files_are_in_natural_order_and_named_shortly(tmp_path):
    for name in ("b/run10.csv", "b/run2.csv", "a/run2.csv"):
        table(tmp_path / name, {"t": 0.05 * np.arange(30), "angle": swing(1.0)[:30, 0]})
    files = list_files([f"{tmp_path}/b/*.csv", f"{tmp_path}/**/run2.csv"])
    assert [str(file.relative_to(tmp_path)) for file in files] == ["a/run2.csv", "b/run2.csv", "b/run10.csv"]
    given = settings([str(file) for file in files], trajectory=None, columns={"theta": "angle"})
    assert [one.name for one in measure(given, NAMES).grid.series] == ["a/run2", "b/run2", "b/run10"]


def test_files_are_those_of_their_checksums_or_refused(tmp_path):
    file, sums = tmp_path / "a.csv", tmp_path / "SHA256SUMS"
    file.write_bytes(b"t,x\n")
    digest = hashlib.sha256(b"t,x\n").hexdigest()
    sums.write_text(f"{digest} *data/a.csv\n")
    verify([file], sums)
    for line, message in (
        (f"{'0' * 64}  a.csv", f"SHA-256 is {digest}; 0{{64}} expected"),
        (f"{digest}  b.csv", "has no line for a.csv"),
        ("a.csv", "line 1: 'a.csv'; expected a SHA-256 and a file's name"),
    ):
        sums.write_text(f"{line}\n")
        with pytest.raises(InputError, match=message):
            verify([file], sums)


@pytest.mark.parametrize(
    ("path", "message"),
    [("none.csv", "no file at"), ("", "is a folder; name its files"), ("a.xlsx", "ends in '.xlsx'")],
)
def test_what_is_no_table_s_file_is_refused(tmp_path, path, message):
    (tmp_path / "a.xlsx").touch()
    with pytest.raises(InputError, match=message):
        list_files(str(tmp_path / path))
