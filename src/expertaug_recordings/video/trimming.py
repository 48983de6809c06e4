"""Which frames of a recording are used, where not all are: those that a player shows in a span of time."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import av
import numpy as np

from expertaug.errors import InputError

WHERE = "recordings.videos"
FEWEST = 2  # frames
SLACK = 1e-3  # of an interval by which a frame may be outside


def shown_ms(path: Path, options: Mapping[str, str], tick_ms: float) -> np.ndarray | None:
    """When a player shows a video's frames in ms from the first, (n,), by its packets alone; None where they do not
    say.

    Arguments:
        options: with which FFmpeg opens the file.
        tick_ms: of its clock.
    """
    ticks: list[int] = []
    with av.open(str(path.absolute()), options=dict(options), metadata_errors="replace") as container:
        try:
            for packet in container.demux(container.streams.video[0]):
                if packet.size and not packet.is_discard:
                    if packet.pts is None:
                        return None
                    ticks.append(packet.pts)
        except av.FFmpegError:  # what is spoiled is told where it is decoded
            pass
    times = np.sort(np.array(ticks, np.float64)) * tick_ms
    return times - times[0] if len(times) else None


def span(where: object, times_s: np.ndarray, from_s: float, to_s: float | None) -> range:
    """Numbers of the frames from one time to another.

    Arguments:
        where: the recording, for messages.
        times_s: of its frames in s, (n,), ascending.
        from_s, to_s: in the same time; None is the end.

    Raises:
        InputError: there are hardly any.
    """
    end = float(times_s[-1]) if to_s is None else to_s
    slack = SLACK * float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
    first, stop = np.searchsorted(times_s, (from_s - slack, end + slack))
    if stop - first < FEWEST:
        found = f"from {from_s:g} to {end:g} s there are {max(0, stop - first)} frames"
        raise InputError(where, found, f"it lasts {times_s[-1]:.3g} s: set {WHERE}.from_s and .to_s within it")
    return range(int(first), int(stop))
