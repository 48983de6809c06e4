"""Settings of recordings: what they leave open is completed, and a mistake is one line."""

from __future__ import annotations

import pytest

from expertaug.errors import InputError
from expertaug_recordings.settings import (
    ChunkKeys,
    ExtractFramesJob,
    RenderVideoJob,
    SplitChunksJob,
    TrackMarkersJob,
)


def test_names_of_long_sets():
    found = SplitChunksJob(horizons_s=[1.0, 0.5]).horizons
    assert list(found) == ["validation_1s", "test_1s", "validation_500ms", "test_500ms"]
    assert found["test_500ms"] == ("test", 0.5)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"speed": 1}, "rendered.speed: unknown key; did you mean 'seed'"),
        ({"launch": {"mass": 1}}, "rendered.launch.mass: unknown key"),
        ({"launch": {"energy": [300, 200]}}, r"launch.energy: found \[300.0, 200.0\]"),
        ({"rate_hz": "1e3"}, "rendered.rate_hz: found '1e3', which YAML takes for a text"),
        ({"image_size_px": 481}, "image_size_px: found 481; give a multiple of 2"),
        ({"duration_s": 0}, "duration_s: found 0"),
        ({"pivot_px": [600, 10]}, "pivot_px: found"),
        ({"crf": 60}, "crf: found 60"),
    ],
)
def test_bad_settings_of_rendering_are_named(settings, message):
    with pytest.raises(InputError, match=message):
        RenderVideoJob.from_mapping(settings)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"rate": 100}, "recordings.rate: unknown key; did you mean 'rate_hz'"),
        ({"rate_hz": "1e3"}, "recordings.rate_hz: found '1e3', which YAML takes for a text"),
        ({"analysis_rate_hz": -1}, "analysis_rate_hz: found -1"),
        ({"image_size_px": [480]}, r"image_size_px: found \[480\]"),
    ],
)
def test_bad_settings_of_frames_are_named(settings, message):
    with pytest.raises(InputError, match=message):
        ExtractFramesJob.from_mapping(settings)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"marker_size": 25}, "settings.marker_size: unknown key"),
        ({"marker_diameter_px": 2}, "marker_diameter_px: found 2; give 8 or more"),
        ({"arm1_px": -4}, "arm1_px: found -4"),
        ({"arm2_px": 0.5}, "arm2_px: found 0.5"),
        ({"max_lost_share": 1.5}, "max_lost_share: found 1.5"),
        ({"arm_search_px": float("nan")}, "arm_search_px: found .nan"),
    ],
)
def test_bad_settings_of_tracking_are_named(settings, message):
    with pytest.raises(InputError, match=message):
        TrackMarkersJob.from_mapping(settings)


def test_a_mask_has_corners():
    with pytest.raises(InputError, match=r"masks\[?.?0"):
        TrackMarkersJob.from_mapping({"masks": [[[1, 2]]]})


@pytest.mark.parametrize(
    ("rate", "expected"), [(400.0, (100.0, 20, 5, 20)), (240.0, (80.0, 17, 4, 16)), (30.0, (30.0, 7, 2, 6))]
)
def test_chunks_keep_their_duration_at_every_rate(rate, expected):
    """But for the points that calibrating needs."""
    found = ChunkKeys().at(rate, "data.split")
    assert (found.rate_hz, found.length, found.stride, found.evaluation_stride) == expected


def test_tolerances_in_px_grow_with_large_markers():
    plain, large = (TrackMarkersJob(marker_diameter_px=size) for size in (20.0, 50.0))
    assert (plain.diameter_tolerance, plain.rim_tolerance) == (4.0, 0.6)
    assert (large.diameter_tolerance, large.rim_tolerance) == (8.0, 1.2)
