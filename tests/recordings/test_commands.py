"""Settings of the stages on recordings, as somebody writes them by hand: refused before any file is looked at."""

from __future__ import annotations

import pytest

from expertaug.cli import main

OUTPUT, PARTS = ["--output", "out"], ["--markers", "none.csv", "--angles", "none.csv", "--summary", "none.json"]
STAGES = {
    "render-video": ["--index", "0", "--output", "out.mp4", "--truth", "out.csv"],
    "extract-frames": ["none.mp4", *OUTPUT],
    "track-markers": ["none.b2frame", *OUTPUT],
    "unpack-markers": ["none.zip", *OUTPUT],
    "import-markers": ["none.csv", *OUTPUT],
    "measure-angles": ["none.csv", *OUTPUT, "--summary", "out.json"],
    "overlay": ["none.mp4", *PARTS, *OUTPUT],
    "draw-worst-frames": ["none.mp4", *PARTS, *OUTPUT, "--rows", "out.csv"],
    "split-chunks": ["none.csv", *OUTPUT],
    "cut-horizon": ["none.csv", *OUTPUT],
    "calibrate": ["none.npz", *OUTPUT],
}
MISSPELT = {
    "render-video": ('{"nois": 0.5}', "nois: unknown key; did you mean 'noise'?"),
    "extract-frames": ('{"rat_hz": 50}', "rat_hz: unknown key; did you mean 'rate_hz'?"),
    "track-markers": ('{"marker": {}}', "marker: unknown key; did you mean 'markers'?"),
    "unpack-markers": ('{"sha265": null}', "sha265: unknown key; did you mean 'sha256'?"),
    "import-markers": ('{"scal": 5}', "scal: unknown key; did you mean 'scale'?"),
    "measure-angles": ('{"rectify": {"elipse": true}}', "rectify.elipse: unknown key; did you mean 'ellipse'?"),
    "overlay": ('{"spede": 1}', "spede: unknown key; did you mean 'speed'?"),
    "draw-worst-frames": ('{"tims": "names"}', "tims: unknown key; did you mean 'times'?"),
    "split-chunks": ('{"by": "enrgy"}', "by: found 'enrgy'"),
    "cut-horizon": (
        '{"split": {"horizons_s": [1.0]}, "set": "test_2s"}',
        "found test_2s; there are validation_1s, test_1s",
    ),
    "calibrate": ('{"step": 0.1}', "step: unknown key"),
}


@pytest.mark.parametrize("stage", STAGES)
def test_misspelt_settings_are_refused_in_a_line_before_anything_is_done(stage, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    settings, message = MISSPELT[stage]
    assert main([stage, *STAGES[stage], "--settings", settings]) == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1, said
    assert not list(tmp_path.iterdir())


def test_each_key_that_has_no_default_is_missed_in_a_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["cut-horizon", *STAGES["cut-horizon"], "--settings", "{}"]) == 2
    said = capsys.readouterr().err
    assert "settings.split: missing" in said and "settings.set: missing" in said and said.count("\n") == 2
