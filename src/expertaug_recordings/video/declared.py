"""What a video's container says beside its frames: how many there are, at which rate they were filmed, and how players
show them: the shape of a pixel, turned, mirrored.
"""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Mapping
from pathlib import Path

import av
import numpy as np
from av.sidedata.sidedata import Type

from expertaug.errors import InputError
from expertaug_recordings.video import timestamps

# Of phones and cinema cameras, whatever stands before: com.android.capture.fps, COM.ARRI.CAMERA.SENSORFPS.
FILMED = re.compile(r"[\w.:-]{0,80}(?:capture|sensor|record)[-_.]?(?:fps|frame[-_.]?rate|rate)", re.ASCII)
RATE = re.compile(r"\s*(\d{1,6}(?:\.\d{1,9})?)(?:\s*/\s*(\d{1,6}))?\s*(?:fps|hz|p|i)?\s*", re.ASCII)
SAME_RATE = 1.1  # ratio of two rates up to which one is the other's nominal value
SAME_MEAN = 1e-3  # relative, of a mean rate that is the same
ASPECTS = (0.125, 8.0)  # of a pixel; outside, its header is forged
SQUARE = 1e-4  # of an aspect: less is no pixel over the largest image
TURN_DEG = 0.5  # by which a display matrix may be off quarter turns
LAST_STEPS = 2.5  # frames by which a container's duration may be off: some count from the first decoding time


GIF = (
    "is a GIF: at most 256 colours, which spoil markers' edges, and times in whole 1/100 s",
    "give the video that it was made from",
)
PICTURE = "is a single picture, or several in a row without reliable times", "give a video, or a folder of pictures"
NO_VIDEOS = {b"GIF8": GIF, b"\x89PNG": PICTURE, b"\xff\xd8\xff": PICTURE, b"II*\0": PICTURE, b"MM\0*": PICTURE}


def no_video(path: Path) -> tuple[str, str]:
    """What a file is that cannot be opened as a video, and what would be right."""
    with path.open("rb") as stream:
        first = stream.read(12)
    if first[:4] == b"RIFF" and first[8:] == b"WEBP":
        return PICTURE
    unknown = "cannot be opened as a video", "it is truncated or not a video: copy the recording again"
    return next((explanation for start, explanation in NO_VIDEOS.items() if first.startswith(start)), unknown)


class FilmedOtherwise(InputError):
    """A file whose tag says that it was filmed at another rate than it is shown, while no rate is stated.

    Attributes:
        rate_hz: at which it was filmed.
        tag: the tag's name.
        shown_hz: rate at which it is shown.
    """

    def __init__(self, path: Path, tag: str, rate_hz: float, shown_hz: float) -> None:
        self.tag, self.rate_hz, self.shown_hz = tag, rate_hz, shown_hz
        super().__init__(
            path,
            f"was filmed at {rate_hz:.6g} Hz by its tag {tag}, but is shown at {shown_hz:.6g} Hz",
            f"set recordings.videos.rate_hz to {rate_hz:.6g}, or to {shown_hz:.6g} if the tag is wrong",
        )


def find_filmed_rate(tags: Mapping[str, str]) -> tuple[str, float] | None:
    """Name and value in Hz of the tag that says at which rate a video was filmed; None without one."""
    for name, value in tags.items():
        match = RATE.fullmatch(value.lower())
        if match and FILMED.fullmatch(name.lower()):
            rate, over = float(match[1]), float(match[2] or 1)
            if rate > 0 and over > 0:
                return name.lower(), rate / over
    return None


def refuse_filmed_otherwise(
    path: Path, container: av.container.InputContainer, options: Mapping[str, str], tick_ms: float, declared_hz: float
) -> None:
    """Refuse a file that is shown slower or faster than it was filmed.

    Arguments:
        path, container: of the file.
        options: with which FFmpeg opens it.
        tick_ms: of its clock.
        declared_hz: its rate by its metadata, which of a variable one is a mean.

    Raises:
        FilmedOtherwise: its tag and its times differ.
    """
    filmed = find_filmed_rate({**container.metadata, **container.streams.video[0].metadata})
    if filmed is None:
        return
    shown = timestamps.shown_ms(path, options, tick_ms)
    usual = 0.0 if shown is None or len(shown) < 2 else float(np.median(np.diff(shown)))
    # Times in whole ms tell a rate less well than the metadata, as long as that is no mean of uneven ones.
    as_declared = usual == 0 or abs(usual * declared_hz / 1000 - 1) < SAME_RATE - 1
    shown_hz = declared_hz if as_declared else 1000 / usual
    if not 1 / SAME_RATE < filmed[1] / shown_hz < SAME_RATE:
        raise FilmedOtherwise(path, *filmed, float(f"{shown_hz:.4g}"))


def frame_count(
    path: Path, container: av.container.InputContainer, options: Mapping[str, str], tick_ms: float, rate_hz: float
) -> int:
    """Frames that a video should have; 0 where nothing says it.

    A container without a count has a duration, which some measure from 0 and not from the first frame.  Where its
    packets last that long, it has as many frames as packets, whatever their times.

    Arguments:
        path, container: of the file.
        options: with which FFmpeg opens it.
        tick_ms: of its clock.
        rate_hz: its rate by its metadata.
    """
    stream = container.streams.video[0]
    if count := count_kept_by_edit_list(container) or stream.frames:
        return count
    length_s = (container.duration or 0) / av.time_base
    times = timestamps.packets_ms(path, options, tick_ms) if length_s > 0 else None
    start_s = max(0.0, float(times[0]) / 1000) if times is not None else 0.0
    lasts = [length_s - start_s, length_s] if 0 < start_s < length_s else [length_s]
    if times is not None and len(times) > 2:
        step = float(np.median(np.diff(times)))
        if any(abs(times[-1] - times[0] + step - 1000 * last) <= LAST_STEPS * step for last in lasts):
            return len(times)
    return math.floor(lasts[0] * rate_hz + 0.5)


def count_kept_by_edit_list(container: av.container.InputContainer) -> int:
    """Frames that a player shows of a clip that was trimmed by an edit list, as phones do it; 0 of any other.

    Its header counts what was filmed; packets that only serve to decode others are to be discarded.
    """
    stream = container.streams.video[0]
    kept = sum(not entry.is_discard for entry in stream.index_entries) if "mov" in container.format.name else 0
    return kept if 0 < kept < stream.frames else 0


def declared_rate(
    path: Path, container: av.container.InputContainer, options: Mapping[str, str], tick_ms: float
) -> float:
    """Frames per second by the metadata; of an MP4 whose frames are evenly shown by its times, where these say
    otherwise.

    Its own rate is a quotient of its header's: of a count that knows no edit list, or with a last frame that lasts
    longer, it is not the rate at which a player shows the frames.

    Arguments:
        path, container: of the file.
        options: with which FFmpeg opens it.
        tick_ms: of its clock.
    """
    stream = container.streams.video[0]
    rate = float(stream.average_rate or stream.guessed_rate or 0)
    entries = stream.index_entries
    if "mov" not in container.format.name or len(entries) < 3:
        return rate
    usual = (entries[-1].timestamp - entries[0].timestamp) / (len(entries) - 1) * tick_ms
    if abs(rate * usual / 1000 - 1) < SAME_MEAN and not count_kept_by_edit_list(container):
        return rate
    shown = timestamps.shown_ms(path, options, tick_ms)
    if shown is None or len(shown) < 3 or not (np.diff(shown) > 0).all():
        return rate
    step, even = timestamps.judge(path, shown, tick_ms)
    return rate if not even or abs(rate * step / 1000 - 1) < SAME_MEAN else float(f"{1000 / step:.6g}")


def pixel_aspect(path: Path, stream: av.VideoStream) -> float:
    """Width of a pixel over its height; 1 where nothing is said.

    Raises:
        InputError: it cannot be one.
    """
    aspect = float(stream.sample_aspect_ratio or 1)
    if not ASPECTS[0] <= aspect <= ASPECTS[1]:
        remedy = f"say the true one: ffmpeg -i {shlex.quote(path.name)} -vf setsar=1 out.mp4"
        raise InputError(path, f"declares pixels {aspect:.3g} times as wide as high", remedy)
    return 1.0 if abs(aspect - 1) < SQUARE else aspect


def orientation(path: Path, frame: av.VideoFrame) -> tuple[int, bool]:
    """How a decoder's frame becomes upright: quarter turns counterclockwise, after it is mirrored left to right or not.

    Raises:
        InputError: a display matrix wants something else.
    """
    matrix = frame.side_data.get(Type.DISPLAYMATRIX)
    if matrix is None:
        return 0, False
    (a, b), (c, d) = np.frombuffer(bytes(matrix), np.int32).reshape(3, 3)[:2, :2].astype(float)
    mirrored = a * d - b * c < 0
    if mirrored:
        a, b = -a, -b
    across, down = np.degrees(np.arctan2(b, a)), np.degrees(np.arctan2(-c, d))
    turns = round(across / 90)
    if not (a or b) or not (c or d) or max(abs(across - 90 * turns), abs((down - across + 180) % 360 - 180)) > TURN_DEG:
        problem = f"its display matrix turns the image by {across:.3g} degrees, or skews it"
        remedy = f"make it upright: ffmpeg -i {shlex.quote(path.name)} -crf 12 out.mp4, or -noautorotate to leave it"
        raise InputError(path, problem, remedy)
    return -turns % 4, mirrored
