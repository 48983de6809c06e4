"""Times of frames: even but for their rounding, or as a camera of variable rate took them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from expertaug.errors import InputError

JITTER = 0.02  # of a step by which times may be off even ones, besides half a tick of their clock
COARSE = 0.2  # of a step that half a tick may be: a missing frame is half a step off


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
