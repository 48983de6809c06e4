"""Stages on recordings: one that is refused stops the run or is passed on as left out, with the reason."""

from __future__ import annotations

import argparse
import json

import pytest

from expertaug.errors import InputError
from expertaug.files import write_json
from expertaug.stages import recordings
from expertaug_recordings.reports.exports import FILES
from expertaug_recordings.settings import MeasureAnglesJob


def measured(folder, mode):
    parser = argparse.ArgumentParser()
    recordings.MeasureAngles.add_arguments(parser)
    outputs = [folder / "angles.csv", folder / "angles.json"]
    words = [
        str(folder / "none.csv"),
        f"--output={outputs[0]}",
        f"--summary={outputs[1]}",
        f"--on-bad-recording={mode}",
    ]
    recordings.MeasureAngles.run(parser.parse_args(words), MeasureAnglesJob(rate_provenance="a label"))
    return outputs


def test_a_recording_that_is_refused_stops_the_run_or_says_why_in_every_output(tmp_path):
    with pytest.raises(InputError, match=r"none\.csv"):
        measured(tmp_path, "stop")
    assert not list(tmp_path.iterdir())
    for path in measured(tmp_path, "skip"):
        assert "none.csv" in json.loads(path.read_text())["refused"]


def test_what_was_left_out_before_is_left_out_of_exports_too(tmp_path):
    write_json(tmp_path / "angles.csv", {"refused": "too dark"})
    given = argparse.Namespace(markers=tmp_path / "m.csv", angles=tmp_path / "angles.csv", output=tmp_path / "out")
    recordings.ExportRecording.run(given, None)
    assert {path.name: path.read_text() for path in (tmp_path / "out").iterdir()} == dict.fromkeys(
        FILES, "left out: too dark\n"
    )


@pytest.mark.parametrize("said", ["x", "=x", "x="])
def test_forecasts_to_draw_have_a_label_and_a_path(said):
    with pytest.raises(InputError, match="--forecasts: found 'x'; give LABEL=PATH"):
        recordings.Overlay.run(argparse.Namespace(forecasts=["a=b", said]), None)
