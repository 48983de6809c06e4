"""What each job on recordings and measurements takes of the configuration: the part from video or table to chunks."""

from __future__ import annotations

from typing import Any

from expertaug.config import jobs
from expertaug.config.layers import merge, plain
from expertaug.config.models import Configuration
from expertaug_recordings.corrections import Correction, read_corrections
from expertaug_recordings.settings import (
    RENDERED,
    CalibrateJob,
    CutHorizonJob,
    ExtractFramesJob,
    ImportMarkersJob,
    MeasureAnglesJob,
    OverlayJob,
    OwnKeys,
    RecordingKeys,
    RenderVideoJob,
    ReviewRecordingJob,
    SplitChunksJob,
    TimeKeys,
    TrackMarkersJob,
    UnpackMarkersJob,
)


def render_video(config: Configuration) -> RenderVideoJob:
    """All but the number of recordings, on which no recording depends."""
    return RenderVideoJob.from_mapping(config.recordings.rendered.dump(exclude=("count",)))


def of_recording(recordings: RecordingKeys, name: str | None) -> RecordingKeys:
    """The block of recordings with what one of them has of its own."""
    own = recordings.by_recording.get(name) if name is not None else None
    return recordings if own is None else with_own(recordings, own)


def with_own(recordings: RecordingKeys, own: OwnKeys) -> RecordingKeys:
    """The block of recordings with what one of them has otherwise.

    Raises:
        InputErrors: a key is unknown or a value cannot be used.
    """
    return RecordingKeys.from_mapping(plain(merge(recordings.dump(), own.dump())))


def extract_frames(config: Configuration, recording: str | None = None) -> ExtractFramesJob:
    recordings = of_recording(config.recordings, recording)
    if recordings.source == "videos":
        stated = recordings.videos.dump(exclude=("path",))
    else:
        rendered = recordings.rendered
        stated = rendered.dump(include=("rate_hz", "image_size_px"))
        stated |= {"rate_provenance": RENDERED, "expected_frames": rendered.frames}
    return ExtractFramesJob.of(analysis_rate_hz=recordings.analysis_rate_hz, **stated)


def track_markers(config: Configuration, recording: str | None = None) -> TrackMarkersJob:
    return TrackMarkersJob.from_mapping(of_recording(config.recordings, recording).tracking.dump())


def unpack_markers(config: Configuration) -> UnpackMarkersJob:
    return UnpackMarkersJob(sha256=config.recordings.markers.sha256)


def import_markers(config: Configuration) -> ImportMarkersJob:
    return ImportMarkersJob.from_mapping(config.recordings.markers.dump(exclude=("path", "sha256")))


def measure_angles(config: Configuration, recording: str | None = None) -> MeasureAnglesJob:
    recordings = of_recording(config.recordings, recording)
    rate, provenance = _rate(recordings)
    placed = corrections(recordings).get(recording, []) if recording is not None else []
    return MeasureAnglesJob.of(
        **recordings.angles.dump(),
        arm1_m=_arms(recordings)[0],
        rate_provenance=provenance,
        rate_hz=rate,
        single=is_single(recordings),
        corrections=placed,
        span_s=_span(recordings),
    )


def corrections(recordings: RecordingKeys) -> dict[str, list[Correction]]:
    """What was placed by hand, by recording."""
    return {} if recordings.corrections is None else read_corrections(recordings.corrections)


def overlay(config: Configuration, recording: str | None = None) -> OverlayJob:
    """What is shown, and the rate by which the video's frames are told."""
    shown = config.recordings.overlay.dump(exclude=("experiment", "variants"))
    return OverlayJob.from_mapping(shown | _times(config, recording))


def review_recording(config: Configuration, recording: str | None = None) -> ReviewRecordingJob:
    return ReviewRecordingJob.from_mapping(_times(config, recording))


def _times(config: Configuration, recording: str | None) -> dict[str, Any]:
    """What is stated of a video's times."""
    return extract_frames(config, recording).dump(include=("rate_hz", "rate_provenance", *TimeKeys.model_fields))


def overlaid(config: Configuration) -> tuple[str, list[str]] | None:
    """The experiment and the variants of its methods whose forecasts are drawn over the videos."""
    chosen = config.recordings.overlay
    experiment = chosen.experiment or next(iter(config.on_recordings), None)
    if experiment is None:
        return None
    return experiment, chosen.variants or jobs.variants(config, experiment)[-1:]


def cut_measurements(config: Configuration, experiment: str) -> dict[str, Any]:
    """Of measurements in files; which files there are the workflow says."""
    settings = config.experiments[experiment]
    # Components and their units are asked of it; the constants that a compound expert needs are fitted to the chunks.
    plain_expert = {"expert": "point_mass"} if settings.data.calibrate else {}
    return {"system": settings.system | plain_expert, "files": settings.data.files.dump(exclude=("horizons_s",))}


def cut_measured_horizon(config: Configuration, experiment: str, name: str) -> dict[str, Any]:
    """Of a set of long chunks, by its name."""
    _, seconds = config.experiments[experiment].data.horizons[name]
    settings = cut_measurements(config, experiment)
    return settings | {"files": settings["files"] | {"horizons_s": [seconds]}, "set": name}


def split_chunks(config: Configuration, experiment: str) -> SplitChunksJob:
    return SplitChunksJob.from_mapping(_split(config, experiment))


def _split(config: Configuration, experiment: str) -> dict[str, Any]:
    split = config.experiments[experiment].data.split.dump(exclude=("horizons_s",))
    return split | ({"single": True} if is_single(config.recordings) else {})


def cut_horizon(config: Configuration, experiment: str, name: str) -> CutHorizonJob:
    """Of a set of long chunks, by its name."""
    _, seconds = config.experiments[experiment].data.horizons[name]
    return CutHorizonJob.from_mapping({"split": _split(config, experiment) | {"horizons_s": [seconds]}, "set": name})


def calibrate(config: Configuration, experiment: str) -> CalibrateJob:
    recordings, data = config.recordings, config.experiments[experiment].data
    if data.source == "files":
        constants = dict.fromkeys(("arm1_m", "arm2_m", "nominal_rate_hz"))
        constants |= {"rate_provenance": "the measurements' own times"}
    else:
        (arm1, arm2), (rate, provenance) = _arms(recordings), _rate(recordings)
        constants = {"arm1_m": arm1, "arm2_m": arm2, "nominal_rate_hz": rate, "rate_provenance": provenance}
    return CalibrateJob.from_mapping(data.calibration.dump() | constants)


def is_single(recordings: RecordingKeys) -> bool:
    """Whether the recordings are of a single pendulum: its tip is said to be none."""
    return recordings.source == "videos" and recordings.tracking.markers.tip is None


def _span(recordings: RecordingKeys) -> list[float | None] | None:
    """First and last second of a video that are used, None where all are."""
    first, last = recordings.videos.from_s, recordings.videos.to_s
    return [first, last] if recordings.source == "videos" and (first > 0 or last is not None) else None


def _arms(recordings: RecordingKeys) -> tuple[float | None, float | None]:
    """Lengths of the two arms in m, None where they are not known."""
    return recordings.arms_m or (None, None)


def _rate(recordings: RecordingKeys) -> tuple[float, str]:
    """Rate of the analysed frames in Hz, and where it is known from."""
    if recordings.source == "markers":
        return recordings.markers.rate_hz, recordings.markers.rate_provenance
    if recordings.source == "rendered":
        return recordings.analysis_rate_hz, RENDERED
    videos = recordings.videos
    default = "the video's metadata" if videos.rate_hz is None else "recordings.videos.rate_hz"
    return recordings.analysis_rate_hz, videos.rate_provenance or default
