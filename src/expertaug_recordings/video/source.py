"""Where frames come from: a video, or a folder of pictures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from expertaug.errors import InputError
from expertaug_recordings.video.pictures import Pictures
from expertaug_recordings.video.reader import Video
from expertaug_recordings.video.settings import ExtractSettings

Frames = Video | Pictures


def open_frames(path: str | Path, settings: Mapping[str, object] | ExtractSettings | None = None) -> Frames:
    """Open and check a recording.

    Arguments:
        path: a video file, or a folder of pictures.
        settings: see :class:`ExtractSettings`; the analysis rate is not used.

    Raises:
        InputError: it cannot be used.
    """
    s = ExtractSettings.from_mapping(settings)
    stated = s.rate_hz, s.rate_provenance, s.expected_frames, s.image_size_px
    frames = Pictures(path, *stated, s.times, s.time_unit_s) if Path(path).is_dir() else Video(path, *stated)
    if s.from_s > 0 or s.to_s is not None:
        try:
            frames.trim(s.from_s, s.to_s)
        except InputError:
            frames.close()
            raise
    return frames
