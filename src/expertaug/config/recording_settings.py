"""What each job on recordings takes of the configuration: the part of :mod:`.stage_settings` from video to chunks."""

from __future__ import annotations

from collections.abc import Mapping

from expertaug.config import jobs
from expertaug.config.layers import merge
from expertaug_recordings.corrections import Correction, read_corrections
from expertaug_recordings.settings import (
    RENDERED,
    CalibrateJob,
    CutHorizonJob,
    ExtractFramesJob,
    ImportMarkersJob,
    MeasureAnglesJob,
    OverlayJob,
    RenderVideoJob,
    ReviewRecordingJob,
    SplitChunksJob,
    TimeKeys,
    TrackMarkersJob,
    UnpackMarkersJob,
)


def render_video(config: Mapping) -> RenderVideoJob:
    """All but the number of recordings, on which no recording depends."""
    return RenderVideoJob.from_mapping({k: v for k, v in config["recordings"]["rendered"].items() if k != "count"})


def of_recording(recordings: Mapping, name: str | None) -> Mapping:
    """The block of recordings with what one of them has of its own."""
    return merge(recordings, recordings["by_recording"].get(name, {})) if name is not None else recordings


def extract_frames(config: Mapping, recording: str | None = None) -> ExtractFramesJob:
    recordings = of_recording(config["recordings"], recording)
    rate = {"analysis_rate_hz": recordings["analysis_rate_hz"]}
    if recordings["source"] == "videos":
        return ExtractFramesJob.from_mapping(rate | {k: v for k, v in recordings["videos"].items() if k != "path"})
    rendered = recordings["rendered"]
    return ExtractFramesJob.from_mapping(
        rate
        | {
            "rate_hz": rendered["rate_hz"],
            "rate_provenance": RENDERED,
            "expected_frames": max(1, round(rendered["duration_s"] * rendered["rate_hz"])),
            "image_size_px": rendered["image_size_px"],
        }
    )


def track_markers(config: Mapping, recording: str | None = None) -> TrackMarkersJob:
    return TrackMarkersJob.from_mapping(of_recording(config["recordings"], recording)["tracking"])


def unpack_markers(config: Mapping) -> UnpackMarkersJob:
    return UnpackMarkersJob(sha256=config["recordings"]["markers"]["sha256"])


def import_markers(config: Mapping) -> ImportMarkersJob:
    markers = config["recordings"]["markers"]
    return ImportMarkersJob.from_mapping({k: v for k, v in markers.items() if k not in ("path", "sha256")})


def measure_angles(config: Mapping, recording: str | None = None) -> MeasureAnglesJob:
    recordings = of_recording(config["recordings"], recording)
    rate, provenance = _rate(recordings)
    return MeasureAnglesJob.from_mapping(
        recordings["angles"]
        | {
            "arm1_m": _arms(recordings)[0],
            "rate_provenance": provenance,
            "rate_hz": rate,
            "single": _single(recordings),
            "corrections": corrections(recordings).get(recording, []) if recording is not None else [],
            "span_s": _span(recordings),
        }
    )


def corrections(recordings: Mapping) -> dict[str, list[Correction]]:
    """What was placed by hand, by recording."""
    path = recordings["corrections"]
    return {} if path is None else read_corrections(path)


def overlay(config: Mapping, recording: str | None = None) -> OverlayJob:
    """What is shown, and the rate by which the video's frames are told."""
    shown = {k: v for k, v in config["recordings"]["overlay"].items() if k not in ("experiment", "variants")}
    return OverlayJob.from_mapping(shown | _times(config, recording))


def review_recording(config: Mapping, recording: str | None = None) -> ReviewRecordingJob:
    return ReviewRecordingJob.from_mapping(_times(config, recording))


def _times(config: Mapping, recording: str | None) -> dict[str, object]:
    """What is stated of a video's times."""
    told = {"rate_hz", "rate_provenance", *TimeKeys.model_fields}
    return extract_frames(config, recording).model_dump(include=told, exclude_unset=True)


def overlaid(config: Mapping) -> tuple[str, list[str]] | None:
    """The experiment and the variants of its methods whose forecasts are drawn over the videos."""
    chosen = config["recordings"]["overlay"]
    known = [e for e in config["run"] if config["experiments"][e]["data"]["source"] == "recordings"]
    experiment = chosen["experiment"] or next(iter(known), None)
    if experiment is None:
        return None
    return experiment, chosen["variants"] or jobs.variants(config, experiment)[-1:]


def cut_measurements(config: Mapping, experiment: str) -> dict:
    """Of measurements in files; which files there are the workflow says."""
    one = config["experiments"][experiment]
    # Components and their units are asked of it; the constants that a compound expert needs are fitted to the chunks.
    plain = {"expert": "point_mass"} if one["data"]["calibrate"] else {}
    files = {k: v for k, v in one["data"]["files"].items() if k != "horizons_s"}
    return {"system": one["system"] | plain, "files": files}


def cut_measured_horizon(config: Mapping, experiment: str, name: str) -> dict:
    """Of a set of long chunks, by its name."""
    _, seconds = jobs.horizons(config, experiment)[name]
    settings = cut_measurements(config, experiment)
    return settings | {"files": settings["files"] | {"horizons_s": [seconds]}, "set": name}


def split_chunks(config: Mapping, experiment: str) -> SplitChunksJob:
    return SplitChunksJob.from_mapping(_split(config, experiment))


def _split(config: Mapping, experiment: str) -> dict:
    split = {k: v for k, v in config["experiments"][experiment]["data"]["split"].items() if k != "horizons_s"}
    return split | ({"single": True} if _single(config["recordings"]) else {})


def cut_horizon(config: Mapping, experiment: str, name: str) -> CutHorizonJob:
    """Of a set of long chunks, by its name."""
    _, seconds = jobs.horizons(config, experiment)[name]
    return CutHorizonJob.from_mapping({"split": _split(config, experiment) | {"horizons_s": [seconds]}, "set": name})


def calibrate(config: Mapping, experiment: str) -> CalibrateJob:
    recordings, data = config["recordings"], config["experiments"][experiment]["data"]
    if data["source"] == "files":
        unknown = dict.fromkeys(("arm1_m", "arm2_m", "nominal_rate_hz"))
        given = unknown | {"rate_provenance": "the measurements' own times"}
    else:
        (arm1, arm2), (rate, provenance) = _arms(recordings), _rate(recordings)
        given = {"arm1_m": arm1, "arm2_m": arm2, "nominal_rate_hz": rate, "rate_provenance": provenance}
    return CalibrateJob.from_mapping(data["calibration"] | given)


def _single(recordings: Mapping) -> bool:
    """Whether the recordings are of a single pendulum: its tip is said to be none."""
    return recordings["source"] == "videos" and recordings["tracking"]["markers"]["tip"] is None


def _span(recordings: Mapping) -> list[float | None] | None:
    """First and last second of a video that are used, None where all are."""
    if recordings["source"] != "videos":
        return None
    first, last = (recordings["videos"][name] for name in ("from_s", "to_s"))
    return [first, last] if first > 0 or last is not None else None


def _arms(recordings: Mapping) -> list[float | None]:
    """Lengths of the two arms in m, None where they are not known."""
    return recordings["arms_m"] or [None, None]


def _rate(recordings: Mapping) -> tuple[float, str]:
    """Rate of the analysed frames in Hz, and where it is known from."""
    source = recordings["source"]
    if source == "markers":
        return recordings["markers"]["rate_hz"], recordings["markers"]["rate_provenance"]
    if source == "rendered":
        return recordings["analysis_rate_hz"], RENDERED
    videos = recordings["videos"]
    default = "the video's metadata" if videos["rate_hz"] is None else "recordings.videos.rate_hz"
    return recordings["analysis_rate_hz"], videos["rate_provenance"] or default
