"""When a recording's frames were taken, evenly but for the rounding of their times or as a camera of variable rate took
them, and which of them are used: those that a player shows in a span of time.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import av
import numpy as np

from expertaug.errors import InputError

JITTER = 0.02  # of a step by which times may be off even ones, besides half a tick of their clock
COARSE = 0.2  # of a step that half a tick may be: a missing frame is half a step off
WHERE = "recordings.videos"
FEWEST = 2  # frames
SLACK = 1e-3  # of an interval by which a frame may be outside


def judge(path: Path, times: np.ndarray, tick: float) -> tuple[float, bool]:
    """The step of times (n,) by least squares, and whether they are even.

    Arguments:
        path: what they are of, for messages.
        times: n > 2, in any unit.
        tick: of the clock that rounds them, in the same unit.

    Raises:
        InputError: they do not grow from frame to frame.
    """
    intervals = np.diff(times)
    if not (intervals > 0).all():
        back = int(np.argmax(~(intervals > 0)))
        raise InputError(path, f"frame {back + 1} is not later than the one before", "copy the recording again")
    number = np.arange(len(times)) - (len(times) - 1) / 2
    step = float(number @ times / (number @ number))
    off = float(np.abs(times - times.mean() - step * number).max())
    return step, off <= JITTER * step + min(0.5 * tick, COARSE * step)


def in_seconds(times_ms: np.ndarray, rate_hz: float | None) -> tuple[float, np.ndarray]:
    """Nominal rate in Hz (of the median interval) of uneven times (n,) in ms, and the times in s from the first.

    Arguments:
        rate_hz: at which the frames were taken, where it is not the rate at which they are shown; times are scaled to
            it.
    """
    shown = 1000 / float(np.median(np.diff(times_ms)))
    nominal = shown if rate_hz is None else rate_hz
    return nominal, (times_ms - times_ms[0]) / 1000 * (shown / nominal)


def shown_ms(path: Path, options: Mapping[str, str], tick_ms: float) -> np.ndarray | None:
    """When a player shows a video's frames in ms from the first, (n,); see :func:`packets_ms`."""
    times = packets_ms(path, options, tick_ms)
    return times - times[0] if times is not None else None


def packets_ms(path: Path, options: Mapping[str, str], tick_ms: float) -> np.ndarray | None:
    """Times of a video's frames in ms, (n,) ascending, by its packets alone; None where they do not say.

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
    return np.sort(np.array(ticks, np.float64)) * tick_ms if ticks else None


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
        problem = f"from {from_s:g} to {end:g} s there are {max(0, stop - first)} frames"
        raise InputError(where, problem, f"it lasts {times_s[-1]:.3g} s: set {WHERE}.from_s and .to_s within it")
    return range(int(first), int(stop))
