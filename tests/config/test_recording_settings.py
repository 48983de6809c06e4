"""What each job on recordings and measurements is told of the configuration."""

from __future__ import annotations

import json

import pytest
import yaml

from expertaug.config import jobs, recording_settings, report_parameters, stage_settings
from expertaug.config import load as config
from expertaug.config.models import Configuration
from expertaug.errors import InputError
from expertaug.learning.settings import TrainSettings
from expertaug_recordings.settings import (
    CalibrateJob,
    ExtractFramesJob,
    ImportMarkersJob,
    MeasureAnglesJob,
    RecordingKeys,
    RenderVideoJob,
    SplitChunksJob,
    TrackMarkersJob,
    UnpackMarkersJob,
)
from shipped import refused


def test_slices_are_settings_of_their_stages(base, tmp_path):
    (tmp_path / "a.mp4").touch()
    for source in ("rendered", "videos", "markers"):
        own = {"rendered": {}, "videos": {"path": str(tmp_path), "from_s": 0.5, "to_s": 2.0}}
        over = {"recordings": {"source": source, source: own.get(source, {"path": str(tmp_path)})}}
        found = config.validate(config.merge(base, over))
        for kind, settings in (
            (RenderVideoJob, recording_settings.render_video(found)),
            (ExtractFramesJob, recording_settings.extract_frames(found)),
            (TrackMarkersJob, recording_settings.track_markers(found)),
            (UnpackMarkersJob, recording_settings.unpack_markers(found)),
            (ImportMarkersJob, recording_settings.import_markers(found)),
            (MeasureAnglesJob, recording_settings.measure_angles(found)),
            (SplitChunksJob, recording_settings.split_chunks(found, "double_pendulum")),
            (CalibrateJob, recording_settings.calibrate(found, "double_pendulum")),
        ):
            assert isinstance(settings, kind)
            kind(**json.loads(settings.model_dump_json(exclude_unset=True)))
        TrainSettings.from_mapping(stage_settings.train(found, "pendulum", "aphynity", "seeds_0_1_2")["training"])


def test_horizons_and_dissipation_of_recordings(base):
    over = yaml.safe_load("experiments: {double_pendulum: {data: {split: {horizons_s: [1.0, 0.5]}}}}")
    found = config.validate(config.merge(base, over))
    sets = ["train", "validation", "test", "validation_1s", "test_1s", "validation_500ms", "test_500ms"]
    assert found.experiments["double_pendulum"].data.set_names == sets
    assert stage_settings.evaluate(found, "double_pendulum", "aphynity", "seeds_0_1_2")["sets"] == sets
    assert found.experiments["pendulum"].data.set_names == ["train", "validation", "iid", "test"]
    assert not recording_settings.split_chunks(found, "double_pendulum").horizons_s, "a horizon redoes no training"
    one = recording_settings.cut_horizon(found, "double_pendulum", "test_500ms")
    assert one.set == "test_500ms" and one.split.horizons_s == [0.5]
    study = report_parameters.study(found, "double_pendulum", "horizons")["options"]
    panels = [["validation", "validation_1s", "validation_500ms"], ["test", "test_1s", "test_500ms"]]
    assert study == {"distances": ["0.19 s", "1 s", "0.5 s"], "panels": [[one[0], one] for one in panels]}
    shown = stage_settings.dissipation(found, "double_pendulum")["versions"]
    refined = ["aphynity~refined", "hvae~refined"]
    assert [v for v, _, fit in shown if fit and v in refined] == refined
    assert [v for v, *_ in shown if v not in refined] == ["least_squares_friction", "aphynity", "hvae", "alternating"]
    assert jobs.dissipating(found, "pendulum") == []
    assert jobs.studies(config.validate(base), "double_pendulum") == ["during_training"]
    assert "found 0.1; chunks end at 0.19 s already" in refused(
        base, "experiments: {double_pendulum: {data: {split: {horizons_s: [0.1]}}}}"
    )


def test_horizons_of_tables(base, tmp_path):
    (tmp_path / "lab.csv").write_text("t,angle,speed\n0,0,0\n")
    files = {"paths": str(tmp_path / "lab.csv"), "columns": {"theta": "angle", "omega": "speed"}, "horizons_s": [1.0]}
    lab = {"based_on": "pendulum", "data": {"source": "files", "files": files}, "methods": ["aphynity"]}
    lab |= {"augmented": ["aphynity"], "controls": [], "refined": [], "flows": []}
    given = config.merge(base, {"run": ["lab"], "experiments": {"lab": lab}})
    found = config.validate(given)
    assert found.experiments["lab"].data.set_names == ["train", "validation", "test", "validation_1s", "test_1s"]
    cut = recording_settings.cut_measurements(found, "lab")
    assert "horizons_s" not in cut["files"], "a horizon redoes no training"
    one = recording_settings.cut_measured_horizon(found, "lab", "test_1s")
    assert one["set"] == "test_1s" and one["files"]["horizons_s"] == [1.0]
    assert report_parameters.study(found, "lab", "horizons")["options"]["distances"] == ["20 points", "1 s"]
    for change, message in (({"horizons_s": [1.0, 1.0]}, "give each once"), ({"step_s": 0.1}, "chunks end at 1.9 s")):
        wrong = {"experiments": {"lab": {"data": {"files": change}}}}
        with pytest.raises(InputError, match=message):
            config.validate(config.merge(given, wrong))


def test_one_recording_may_have_keys_of_its_own():
    block = RecordingKeys.of(
        source="videos",
        videos={"path": "videos"},
        by_recording={"b": {"videos": {"rate_hz": 240.0}}},
    )
    found = Configuration.model_construct(recordings=block)
    assert recording_settings.extract_frames(found, "b").rate_hz == 240.0
    assert recording_settings.extract_frames(found, "a") == recording_settings.extract_frames(found)
    assert recording_settings.extract_frames(found).rate_hz is None
