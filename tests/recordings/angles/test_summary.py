"""A recording's summary: what is saved is loaded, and what was altered is one line."""

from __future__ import annotations

import json

import pytest
from angle_files import summary

from expertaug.errors import InputError
from expertaug_recordings.angles.summary import RecordingSummary, TimingSummary

KNOWN = summary("r0", 400, 100.0, (118.0, 90.0), (240.0, 238.0), timing=TimingSummary(torn=3, error_deg=(0.1, 0.5)))


def test_what_is_saved_is_loaded(tmp_path):
    KNOWN.save(tmp_path / "angles.json")
    assert RecordingSummary.load(tmp_path / "angles.json") == KNOWN


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"usable_share": 1.5}, "usable_share: Input should be less than or equal to 1"),
        ({"timing": {"torn": -1}}, r"timing\.torn: Input should be greater than or equal to 0"),
        ({"frames": 4.5}, "frames: Input should be a valid integer"),
        ({"pendulum": "triple"}, "pendulum: Input should be 'double' or 'single'"),
    ],
)
def test_a_value_that_cannot_be_is_one_line(tmp_path, change, message):
    (tmp_path / "angles.json").write_text(json.dumps(KNOWN.model_dump() | change))
    with pytest.raises(InputError, match=rf"angles\.json: {message}; run measure_angles again") as error:
        RecordingSummary.load(tmp_path / "angles.json")
    assert "\n" not in str(error.value)


def test_a_summary_that_is_not_there_is_asked_for(tmp_path):
    with pytest.raises(InputError, match="no such file; run measure_angles"):
        RecordingSummary.load(tmp_path / "angles.json")
