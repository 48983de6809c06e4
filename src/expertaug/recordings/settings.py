"""The block ``recordings`` of a configuration: from the recordings' source to angles."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from expertaug.recordings.angles.settings import AngleKeys
from expertaug.recordings.imports.settings import MarkerSettings, Sha256
from expertaug.recordings.markers.settings import TrackKeys
from expertaug.recordings.rendering.settings import Rendered
from expertaug.recordings.reports.settings import OverlayKeys
from expertaug.recordings.video.settings import SizePair, TimeKeys
from expertaug.settings import LEFT_OUT, LIST, ONE, Positive, PositivePair, Settings, by_shape, key


class VideoKeys(TimeKeys):
    """Your own videos, in any usual container that FFmpeg reads, or folders of pictures."""

    path: Annotated[Annotated[str, ONE] | Annotated[list[str], LIST], by_shape] | None = key(
        None,
        "a folder, a file or a glob, or a list of them; each video, and each folder of pictures, is a recording of its "
        "name",
    )
    rate_hz: Positive | None = key(None, "frames per second; null = as the file says", "Hz")
    rate_provenance: str | None = key(
        None, "where that rate is known from, kept in the reports; null = the file, or this configuration"
    )
    image_size_px: SizePair | None = key(None, "width and height that every video must have; null = any", "px")


class MarkerKeys(MarkerSettings):
    """Marker CSVs in the layout of IBM's Double Pendulum Chaotic dataset."""

    path: str | None = key(None, "a folder of CSVs, or its .tar.gz or .zip")
    sha256: Sha256 | None = key(None, "SHA-256 of the archive; null = not checked")


class OwnKeys(Settings):
    """What differs in one recording from the blocks of these names."""

    tracking: dict[str, Any] = key(LEFT_OUT, "keys of recordings.tracking")
    angles: dict[str, Any] = key(LEFT_OUT, "keys of recordings.angles")
    videos: dict[str, Any] = key(LEFT_OUT, "keys of recordings.videos, but for path")


class RecordingKeys(Settings):
    """Recordings of a double pendulum, from their source to angles."""

    source: Literal["rendered", "videos", "markers"] = key(
        "rendered", "rendered = simulated and drawn; videos = your files; markers = marker positions"
    )
    analysis_rate_hz: Positive = key(
        400.0,
        "frames per second that are analysed; angles of a video of another or a variable rate are resampled to it",
        "Hz",
    )
    on_bad_recording: Literal["stop", "skip"] = key(
        "stop",
        "a recording that is refused by any stage - stop = the run ends; skip = it goes on without it, and the table "
        "of recordings says why",
    )
    checksums: str | None = key(
        None, "file of SHA-256 checksums of the videos or marker CSVs, as sha256sum writes it; null = not checked"
    )
    corrections: str | None = key(
        None,
        "CSV of markers placed by hand: recording, frame, marker (pivot, joint, tip; all = do not use it), x, y",
    )
    arms_m: PositivePair | None = key(
        (0.091, 0.070),
        "lengths of the two arms, which give the frame rate that the motion implies; null = not known",
        "m",
    )
    rendered: Rendered = key(Rendered, "the embedded default, simulated and rendered as video")
    videos: VideoKeys = key(VideoKeys, "your own videos, in any usual container that FFmpeg reads")
    markers: MarkerKeys = key(MarkerKeys, "marker CSVs in the layout of IBM's Double Pendulum Chaotic dataset")
    tracking: TrackKeys = key(TrackKeys, "of the marker tracker; lengths in px")
    angles: AngleKeys = key(AngleKeys, "from marker positions to arm angles")
    by_recording: dict[str, OwnKeys] = key(
        dict, "what differs by recording, by its name: expertaug inspect proposes it"
    )
    overlay: OverlayKeys = key(
        OverlayKeys,
        "videos with markers, arms, angles and forecasts drawn over the frames (the target overlay makes them)",
    )
