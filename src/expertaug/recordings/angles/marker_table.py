"""A recording's markers as tracking or import left them: markers.csv, read and checked."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.recordings.columns import MARKERS, PLACES
from expertaug.recordings.tables import read_table

FEWEST = 10  # frames of a recording


@dataclass(frozen=True)
class MarkerTable:
    """Markers of n evenly timed frames.

    Attributes:
        frame: their numbers, (n,).
        t: their times in s, (n,).
        rate_hz: frames per second.
        pivot, joint, tip: places (x, y) in px, y down, (n, 2); NaN where a marker was not found.
        quality: (n,), 0 where a frame is unusable.
        reason: (n,) texts: why, or empty.
    """

    frame: np.ndarray
    t: np.ndarray
    rate_hz: float
    pivot: np.ndarray
    joint: np.ndarray
    tip: np.ndarray
    quality: np.ndarray
    reason: np.ndarray

    def __len__(self) -> int:
        return len(self.t)


def read_markers(path: Path) -> MarkerTable:
    """Read a markers.csv.

    Raises:
        InputError: the file is missing or no such table (:func:`expertaug.recordings.tables.read_table`), has too few
            frames or uneven times.
    """
    table = read_table(path, MARKERS[:-1], MARKERS[-1:], "track_markers")
    if len(table) < FEWEST:
        raise InputError(path, f"{len(table)} frames", f"a recording needs at least {FEWEST}")
    frame, t, quality, reason = (table[name].to_numpy() for name in ("frame", "t", "quality", "reason"))
    pivot, joint, tip = table[list(PLACES)].to_numpy(float).reshape(-1, 3, 2).swapaxes(0, 1)
    return MarkerTable(frame, t, _frame_rate(path, t), pivot, joint, tip, quality, reason)


def _frame_rate(path: Path, t: np.ndarray) -> float:
    rate = (len(t) - 1) / (t[-1] - t[0]) if t[-1] > t[0] else np.nan
    uneven = ~(np.abs(np.diff(t) * rate - 1) < 0.01)
    if uneven.any():
        row = int(np.argmax(uneven))
        found = f"times are uneven: {t[row]} s, then {t[row + 1]} s"
        raise InputError(path, found, "expected every analysed frame, evenly timed")
    return float(round(rate, 6))
