"""Forecasts of a recording's chunks, placed by the recording and the frame that they carry."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.evaluation.forecast_file import Forecasts

ANGLES = ("theta1", "theta2")


@dataclass(frozen=True)
class Forecast:
    """Forecast angles (n, 2) in rad at the rows (n,) of a recording, by the method of this label."""

    label: str
    rows: np.ndarray
    theta: np.ndarray

    def at(self, row: int) -> np.ndarray:
        """Angles (2,) at a row between the first and the last."""
        return np.array([np.interp(row, self.rows, self.theta[:, k]) for k in range(2)])


def read_forecasts(
    files: Mapping[str, str | Path], recording: str, frame: np.ndarray, rate_hz: float
) -> list[Forecast]:
    """Those forecasts that are of a recording, in order of time; by each method's first seed.

    Arguments:
        files: forecasts.npz (:mod:`expertaug.evaluation.forecast_file`) by the method's label.
        recording: its name.
        frame: (n,), the numbers of its rows' frames, ascending.
        rate_hz: rows per second.

    Raises:
        InputError: a file cannot be used, does not say of which chunks it is or is of frames that are not there.
    """
    found = [f for label, path in files.items() for f in _of_method(label, Path(path), recording, frame, rate_hz)]
    return sorted(found, key=lambda f: int(f.rows[0]))


def _of_method(label: str, path: Path, recording: str, frame: np.ndarray, rate_hz: float) -> Iterator[Forecast]:
    stored = Forecasts.load(path)
    if not set(ANGLES) <= set(stored.state_names):
        return
    columns = [stored.state_names.index(name) for name in ANGLES]
    steps = np.rint((stored.t - stored.t[0]) * rate_hz).astype(int)
    for name, prediction in stored.prediction.items():
        if name not in stored.id:
            raise InputError(path, f"does not say of which chunks its {name} forecasts are", "run evaluate again")
        for identity, states in zip(stored.id[name], prediction[0], strict=True):
            of, _, first = str(identity).rpartition("/")
            if of != recording:
                continue
            start = int(np.searchsorted(frame, int(first))) if first.isdecimal() else len(frame)
            if start + steps[-1] >= len(frame) or frame[start] != int(first):
                found = f"forecasts {str(identity)!r} over {steps[-1] + 1} frames"
                raise InputError(path, found, f"{recording} has no such frames: run evaluate again")
            yield Forecast(label, start + steps, states[:, columns].astype(float))
