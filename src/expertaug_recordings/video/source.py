"""Where frames come from: a video, or a folder of pictures."""

from __future__ import annotations

from pathlib import Path

from expertaug.errors import InputError
from expertaug_recordings.settings import StatedTimes
from expertaug_recordings.video.pictures import Pictures
from expertaug_recordings.video.reader import Video

Frames = Video | Pictures


def open_frames(
    path: str | Path,
    stated: StatedTimes,
    expected_frames: int | None = None,
    image_size_px: int | tuple[int, int] | None = None,
) -> Frames:
    """Open and check a recording.

    Arguments:
        path: a video file, or a folder of pictures.
        stated: of its times.
        expected_frames, image_size_px: what it must have; None takes what comes.

    Raises:
        InputError: it cannot be used.
    """
    known = stated.rate_hz, stated.rate_provenance, expected_frames, image_size_px
    series = Path(path).is_dir()
    frames = Pictures(path, *known, stated.times, stated.time_unit_s) if series else Video(path, *known)
    if stated.from_s > 0 or stated.to_s is not None:
        try:
            frames.trim(stated.from_s, stated.to_s)
        except InputError:
            frames.close()
            raise
    return frames
