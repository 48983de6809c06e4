"""Atomic writing: a reader never sees half a file, and a full or closed folder is one clear line."""

import errno
import os

import pytest

from expertaug.errors import InputError
from expertaug.files import atomic, read_json, write_json, write_text


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, code):
    write_text(tmp_path / "a.txt", "old")

    def full(_):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr("expertaug.files.os.fsync", full)
    with pytest.raises(InputError, match=r"a\.txt: cannot be written.*free some space"):
        write_text(tmp_path / "a.txt", "new")
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "results").write_text("a file where the folder should be")
    with pytest.raises(InputError, match=r"cannot be written.*choose a writable results folder"):
        write_text(tmp_path / "results" / "a.txt", "text")


def test_a_failing_block_leaves_nothing(tmp_path):
    with pytest.raises(KeyError), atomic(tmp_path / "a.npz") as temporary:
        temporary.write_text("half")
        raise KeyError
    assert list(tmp_path.iterdir()) == []


def test_json_round_trip_and_refusals(tmp_path):
    write_json(tmp_path / "a.json", {"x": [1, 2.5, None]})
    assert read_json(tmp_path / "a.json") == {"x": [1, 2.5, None]}
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "b.json", float("nan"))
    (tmp_path / "c.json").write_text("{")
    with pytest.raises(InputError, match="not JSON"):
        read_json(tmp_path / "c.json")
    with pytest.raises(InputError, match="no such file"):
        read_json(tmp_path / "d.json")
