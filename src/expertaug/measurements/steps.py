"""The time from row to row of trajectories: the usual one, and the one of a grid that they lie on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from expertaug.errors import InputError
from expertaug.measurements.settings import MeasurementSettings
from expertaug.measurements.trajectory import WHERE, Rows

FITTING = 0.5  # part of the steps from row to row that must lie on a grid
WELL, PARTS = 0.9, 5  # part that lies on one where rows are missing, and of how many of its steps the usual one is
NEAR = 1e-6  # relative distance of a step from a number of few digits that is taken for it


def own_step(trajectories: Sequence[Rows]) -> float:
    """The usual time from row to row in s: the median over all trajectories."""
    steps = np.concatenate([np.diff(one.t) for one in trajectories])
    if not len(steps):
        raise InputError(f"{WHERE}.time", "every trajectory has one row", "name the trajectory column, or none")
    return float(np.median(steps))


def fitted(trajectories: Sequence[Rows], settings: MeasurementSettings, median: float) -> float:
    """The step in s that fits the rows best: the usual one or, where many rows are missing, a part of it."""
    steps = np.concatenate([np.diff(one.t) for one in trajectories]) / median

    def on(parts: int) -> np.ndarray:
        whole = np.rint(steps * parts)
        close = np.abs(steps * parts - whole) <= settings.tolerance
        return close & (whole >= 1) & (whole <= settings.longest_gap + 1)

    parts = 1
    if on(1).mean() < WELL:
        parts = max(range(1, PARTS + 1), key=lambda k: (on(k).mean(), -k))
        parts = parts if on(parts).mean() >= WELL else 1
    good, whole = on(parts), np.rint(steps * parts)
    if good.mean() < FITTING:
        found = (
            f"times from row to row are {median * steps.min():.3g} to {median * steps.max():.3g} s, usually "
            f"{median:.3g}: {100 * (1 - good.mean()):.0f} % lie more than {settings.tolerance:g} of that off a grid"
        )
        raise InputError(f"{WHERE}.time", found, "set uneven to own or interpolate, or a larger tolerance")
    return plain(median * steps[good].sum() / whole[good].sum())


def plain(step_s: float) -> float:
    """A step, or its rate, of few digits where one is near: times that are written with few digits are meant so."""
    for candidate in (float(f"{step_s:.5g}"), 1 / float(f"{1 / step_s:.5g}")):
        if abs(candidate / step_s - 1) < NEAR:
            return candidate
    return float(f"{step_s:.9g}")
