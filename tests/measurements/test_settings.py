"""Settings of measurements: what they make of each other, and one line for each mistake before a file is read."""

from __future__ import annotations

import json
import re

import pytest
from swings import GIVEN

from expertaug.cli import main
from expertaug.errors import InputError
from expertaug.measurements.settings import MeasurementSettings, points_in

FILES = GIVEN | {"paths": "x.csv"}
MISSPELT = [
    (
        "cut-measurements",
        {"system": {"name": "pendulum"}, "sytem": {}, "files": FILES},
        r"--settings\.sytem: unknown key; .*'system'",
    ),
    ("cut-measurements", {"files": FILES}, r"--settings\.system: missing"),
    ("cut-measurements", {"system": {"name": "pendulum"}}, r"--settings\.files: missing"),
    ("cut-measurements", {"system": {"name": "pendulum"}, "files": FILES, "set": "test_1s"}, r"settings\.set: unknown"),
    (
        "cut-measurements",
        {"system": {"name": "pendulum"}, "files": FILES | {"split": {"by": "tme"}}},
        r"files\.split\.by: found 'tme'; did you mean 'time'",
    ),
    ("cut-measured-horizon", {"system": {"name": "pendulum"}, "files": FILES}, r"--settings\.set: missing"),
    (
        "cut-measured-horizon",
        {"system": {"name": "pendulum"}, "files": FILES | {"horizons_s": [2.0]}, "set": "test_1s"},
        r"--settings\.set: found 'test_1s'; files\.horizons_s makes validation_2s, test_2s",
    ),
]


@pytest.mark.parametrize(("command", "job", "message"), MISSPELT)
def test_a_job_is_refused_before_a_file_is_read(tmp_path, capsys, command, job, message):
    missing = str(tmp_path / "never_opened.csv")
    assert main([command, missing, "--output", str(tmp_path / "out"), "--settings", json.dumps(job)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and re.search(message, said), said


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stride": 21}, "data.files.stride: found 21; give at most the length, 20"),
        ({"horizons_s": [1.0, 1.0]}, "horizons_s: .*give each once"),
        ({"step_s": 0.05, "horizons_s": [0.5]}, r"horizons_s\[0\]: found 0.5; chunks end at 0.95 s already"),
        ({"thousands": "."}, "thousands: found '.'; the decimal separator is another"),
        ({"separator": "ab"}, "separator: found 'ab'; give one character, tab or space"),
        ({"z_e": {"omega0": {"name": "f", "start": "omega"}}}, "z_e.omega0: found both name and start; give one"),
        ({"split": {"thresholds": [2.0, 1.0]}}, "split.thresholds: .*the first must not exceed the second"),
        ({"split": {"by": "column"}}, "split.column: column is missing; by is column: give column"),
    ],
)
def test_keys_that_do_not_agree_are_one_line(change, message):
    with pytest.raises(InputError, match=message) as error:
        MeasurementSettings.from_mapping(FILES | change)
    assert "\n" not in str(error.value)


def test_further_sets_and_limits_follow_from_the_keys():
    found = MeasurementSettings.from_mapping(FILES | {"horizons_s": [2, 2.5], "max_chunks": {"train": 5}})
    assert found.horizons == {
        "validation_2s": ("validation", 2.0),
        "test_2s": ("test", 2.0),
        "validation_2500ms": ("validation", 2.5),
        "test_2500ms": ("test", 2.5),
    }
    assert (found.limit("train"), found.limit("test"), points_in(2.0, 0.05)) == (5, None, 41)
    assert found.split.shares == (0.6, 0.2, 0.2) and found.split.values("test") == ["test"]
