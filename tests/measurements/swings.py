"""Swings of a damped pendulum as a lab would measure them, and tables of them."""

from __future__ import annotations

import functools
import math
from pathlib import Path

import numpy as np

from expertaug.measurements.names import Names
from expertaug.measurements.settings import MeasurementSettings

NAMES = Names({"theta": "rad", "omega": "rad/s"}, {"omega0": "rad/s"})
STEP = 0.05
# How :func:`trials` are read.
GIVEN = {
    "trajectory": "trial",
    "columns": {"theta": "angle", "omega": "speed"},
    "length": 20,
    "stride": 4,
    "evaluation_stride": 10,
    "min_chunks": 1,
}


def swing(theta0: float, omega0: float = 2.0, alpha: float = 0.1, points: int = 200, step: float = STEP) -> np.ndarray:
    """θ and θ' (points, 2) by Runge and Kutta's steps of a tenth of ``step``."""
    return _swing(theta0, omega0, alpha, points, step).copy()


@functools.cache
def _swing(theta0: float, omega0: float, alpha: float, points: int, step: float) -> np.ndarray:
    def pull(theta: float, omega: float) -> float:
        return -(omega0**2) * math.sin(theta) - alpha * omega

    q, v, h, found = float(theta0), 0.0, step / 10, []
    for _ in range(points):
        found.append((q, v))
        for _ in range(10):
            a, va = pull(q, v), v
            b, vb = pull(q + h / 2 * va, v + h / 2 * a), v + h / 2 * a
            c, vc = pull(q + h / 2 * vb, v + h / 2 * b), v + h / 2 * b
            d, vd = pull(q + h * vc, v + h * c), v + h * c
            q, v = q + h / 6 * (va + 2 * vb + 2 * vc + vd), v + h / 6 * (a + 2 * b + 2 * c + d)
    return np.array(found)


def table(path: Path, rows: dict[str, object], separator: str = ",", comment: str = "") -> Path:
    """A CSV of columns; numbers in full, texts as they are."""
    columns = [
        [v if isinstance(v, str) else "" if np.isnan(v) else repr(float(v)) for v in one] for one in rows.values()
    ]
    lines = [separator.join(rows), *(separator.join(cells) for cells in zip(*columns, strict=True))]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(comment + "\n".join(lines) + "\n", encoding="utf-8")
    return path


def trials(folder: Path, count: int = 6, noise: float = 0.0, points: int = 200) -> Path:
    """One CSV of several trials: trial, t, angle, speed."""
    rng, parts = np.random.default_rng(0), []
    for k in range(count):
        y = swing(0.3 + 0.2 * k, points=points)
        y = y + noise * rng.standard_normal(y.shape)
        parts.append(np.column_stack((np.full(points, k), STEP * np.arange(points), y)))
    every = np.concatenate(parts)
    return table(folder / "swings.csv", dict(zip(("trial", "t", "angle", "speed"), every.T, strict=True)))


def settings(path: Path | list[str], **given: object) -> MeasurementSettings:
    """Settings that read :func:`trials`."""
    paths = str(path) if isinstance(path, Path) else path
    return MeasurementSettings(**GIVEN | {"paths": paths} | given)
