"""What recordings may be called, and in which order they come."""

from pathlib import Path, PurePosixPath

import pytest

from expertaug.config.sources import list_videos
from expertaug.errors import InputError
from expertaug_recordings.ibm import list_marker_files
from expertaug_recordings.names import MOST, by_name

NAMES = {
    "{x}": "_x_",
    "a<b": "a_b",
    "a\nb": "a_b",
    "a\udcff": "a_",
    "archive": "recording_archive",
    "summary.csv": "recording_summary.csv",
    "..": "recording",
}


@pytest.mark.parametrize("name", NAMES)
def test_names_that_would_be_taken_for_something_else(name):
    with pytest.raises(InputError, match="a recording is called after its file: rename it") as error:
        by_name("folder", [PurePosixPath(f"{name}.mp4")])
    assert str(error.value).endswith(f"to '{NAMES[name]}.mp4' for instance") and "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["clip 1", "a,b;c", "[x]*?", "été", "a%b&c", "it's", 'a"b', "a\\b", "~a", "-n", "10"])
def test_names_that_may_be(name):
    assert list(by_name("folder", [PurePosixPath(f"{name}.mp4")])) == [name]


@pytest.mark.parametrize(("suffix", "listed"), [(".mp4", list_videos), (".csv", list_marker_files)])
def test_both_kinds_of_recordings_are_checked(tmp_path, suffix, listed):
    for name in ("10", "9"):
        (tmp_path / f"{name}{suffix}").write_text("x")
    assert list(listed(str(tmp_path))) == ["9", "10"]
    (tmp_path / f"a<b{suffix}").write_text("x")
    with pytest.raises(InputError, match=f"'a<b{suffix}'; .* 'a_b{suffix}'"):
        listed(str(tmp_path))


def test_names_are_not_compared_in_pairs():
    class Counted(PurePosixPath):
        looks = 0

        @property
        def stem(self):
            Counted.looks += 1
            return super().stem

    count = 2000
    assert len(by_name("archive", [Counted(f"{k}.csv") for k in range(count)])) == count
    assert Counted.looks < 10 * count


def test_too_many_recordings():
    with pytest.raises(InputError, match=f"{MOST + 1} files; at most {MOST} recordings"):
        by_name("archive", [Path(f"{k}.csv") for k in range(MOST + 1)])
