"""The block ``recordings`` of a configuration: from the recordings' source to angles."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from expertaug.settings import LEFT_OUT, LIST, ONE, Positive, PositivePair, Settings, by_shape, key
from expertaug_recordings.angles.settings import AngleKeys
from expertaug_recordings.imports.settings import MarkerSettings, Sha256
from expertaug_recordings.markers.settings import TrackKeys
from expertaug_recordings.rendering.settings import Rendered
from expertaug_recordings.reports.settings import OverlayKeys
from expertaug_recordings.video.settings import SizePair, TimeKeys


class VideoKeys(TimeKeys):
    """Your own videos, in any usual container that FFmpeg reads, or folders of pictures."""

    path: Annotated[Annotated[str, ONE] | Annotated[list[str], LIST], by_shape] | None = key(
        None,
        "a folder, a file or a glob, or a list of these; each video and each folder of pictures is a recording, named "
        "after it",
    )
    rate_hz: Positive | None = key(None, "frames per second; null = as stated in the file", "Hz")
    rate_provenance: str | None = key(
        None, "where that rate comes from; kept in the reports; null = the file, or this configuration"
    )
    image_size_px: SizePair | None = key(None, "width and height that every video must have; null = any", "px")


class MarkerKeys(MarkerSettings):
    """Marker CSVs in the layout of IBM's Double Pendulum Chaotic dataset."""

    path: str | None = key(None, "a folder of CSVs, or an archive of it as .tar.gz or .zip")
    sha256: Sha256 | None = key(None, "SHA-256 of the archive; null = not checked")


class OwnKeys(Settings):
    """What differs in one recording from the blocks of these names."""

    tracking: dict[str, Any] = key(LEFT_OUT, "keys of recordings.tracking")
    angles: dict[str, Any] = key(LEFT_OUT, "keys of recordings.angles")
    videos: dict[str, Any] = key(LEFT_OUT, "keys of recordings.videos, except path")


class RecordingKeys(Settings):
    """Recordings of a double pendulum, from their source to angles."""

    source: Literal["rendered", "videos", "markers"] = key(
        "rendered", "rendered = simulated and drawn; videos = your files; markers = marker positions"
    )
    analysis_rate_hz: Positive = key(
        400.0,
        "frames per second that are analysed; the angles of a video with another or a variable rate are resampled to "
        "it",
        "Hz",
    )
    on_bad_recording: Literal["stop", "skip"] = key(
        "stop",
        "what happens if any stage refuses a recording: stop = the run ends; skip = it goes on without that "
        "recording, and the table of recordings says why",
    )
    checksums: str | None = key(
        None, "file with the SHA-256 checksums of the videos or marker CSVs, as sha256sum writes it; null = not checked"
    )
    corrections: str | None = key(
        None,
        "CSV of markers placed by hand, with the columns recording, frame, marker (pivot, joint, tip; all = do not "
        "use the frame), x, y",
    )
    arms_m: PositivePair | None = key(
        (0.091, 0.070),
        "lengths of the two arms, from which the frame rate that the motion implies is computed; null = not known",
        "m",
    )
    rendered: Rendered = key(Rendered, "the built-in default, simulated and rendered as video")
    videos: VideoKeys = key(VideoKeys, "your own videos, in any common container that FFmpeg reads")
    markers: MarkerKeys = key(MarkerKeys, "marker CSVs in the layout of IBM's Double Pendulum Chaotic dataset")
    tracking: TrackKeys = key(TrackKeys, "settings of the marker tracker; lengths in px")
    angles: AngleKeys = key(AngleKeys, "how arm angles are measured from marker positions")
    by_recording: dict[str, OwnKeys] = key(
        dict, "settings that differ between recordings, by the recording's name; expertaug inspect proposes them"
    )
    overlay: OverlayKeys = key(
        OverlayKeys,
        "videos with markers, arms, angles and forecasts drawn over the frames (the target overlay makes them)",
    )
