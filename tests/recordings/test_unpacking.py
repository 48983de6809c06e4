"""Members of archives that nobody vouches for."""

from __future__ import annotations

from pathlib import PurePosixPath

import pytest

from expertaug.errors import InputError
from expertaug_recordings.unpacking import Member, choose_members


def test_which_members_of_an_archive_are_unpacked():
    listed = [Member("a/", 0, False, False), Member("a/1.csv", 9, True, False), Member("a/README", 9, True, False)]

    def csvs(paths):
        return [path for path in paths if path.suffix == ".csv"]

    assert choose_members(listed, csvs) == [(PurePosixPath("a/1.csv"), "a/1.csv")]
    for member, problem in (
        (Member("b", 0, False, True), "member 'b' is a link or a device"),
        (Member("../b.csv", 1, True, False), "would land outside"),
        (Member("c.csv", 2**31, True, False), "take more than 1024 MiB"),
    ):
        with pytest.raises(InputError, match=f"archive: .*{problem}"):
            choose_members([*listed, member], csvs)
