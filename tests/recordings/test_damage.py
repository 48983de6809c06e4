"""Damaged and hostile recordings: a share of benchmarks/damage.py, which runs hours if it is let."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Summary, and rows of the named cases by name."""
    folder = tmp_path_factory.mktemp("damage")
    command = [sys.executable, ROOT / "benchmarks" / "damage.py", folder, "--mutations", "1500", "--every", "4"]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=300)
    failures = (folder / "failures.csv").read_text() if (folder / "failures.csv").exists() else done.stderr
    assert done.returncode == 0, failures
    with (folder / "cases.csv").open(newline="") as stream:
        cases = {row["case"]: row for row in csv.DictReader(stream)}
    return json.loads((folder / "summary.json").read_text()), cases


def test_no_case_crashes_hangs_or_is_used_where_it_can_be_told(report):
    summary, cases = report
    assert summary["failures"] == 0
    assert sum(n for kind in summary["mutations"].values() for n in kind.values()) == 1500
    assert len(cases) > 500
    assert {row["outcome"] for row in cases.values()} == {"read", "refused", "timed", "altered"}


@pytest.mark.parametrize(
    ("case", "outcome", "message"),
    [
        ("mp4", "read", ""),
        ("mkv", "read", ""),
        ("tar", "read", ""),
        ("alien: playlist", "refused", "cannot be opened as a video"),
        ("metadata: no frames", "refused", "ends after 0 of 24 declared frames"),
        ("metadata: huge time scale", "refused", "no usable frame rate"),
        ("metadata: JPEG of 1 px", "refused", "declares images of 1x2 px"),
        ("packets: frame missing in mp4.mp4", "timed", "23 frames of"),
        ("packets: late frame in mp4.mkv", "timed", "frames of"),
        ("packets: frames exchanged in mp4.mp4", "refused", "spoiled near frame 9"),
        ("cell: 1e308", "refused", "row 8, column y_green: 1e+308"),
        ("cell: underscore", "refused", "row 8, column y_green: '9_77' is no number"),
        ("cell: escape", "refused", r"'\x1b[2J' is no number"),
        ("file: byte order mark", "read", ""),
        ("file: UTF-16", "refused", "not a CSV"),
        ("archive: same member twice", "refused", "two members are called '1.csv'"),
        ("archive: header of 3 GiB", "refused", "neither a tar nor a zip archive"),
        ("archive: x.bin of 64 GiB of zeros", "refused", "do not trust this archive"),
        ("archive: a million members", "refused", "holds more than 100000 members"),
        ("archive: zip of 2 GiB of zeros", "refused", "take more than 1024 MiB"),
        ("archive: zip that lies about sizes", "refused", "Bad CRC-32"),
    ],
)
def test_named_cases(report, case, outcome, message):
    row = report[1][case]
    assert row["outcome"] == outcome
    assert message in row["message"]
