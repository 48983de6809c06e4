"""What a method's augmented versions gain: over their controls of equal compute, and beside the base model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import pandas as pd

from expertaug.versions import CONTROL, ESTIMATOR, Version

if TYPE_CHECKING:
    from expertaug.evaluation.intervals import Interval
    from expertaug.evaluation.samples import Samples

# Only the first is a gain of augmentation: an augmented version was also trained for longer than its base.
OVER_CONTROL, FROM_BASE = "gain over control", "difference from base"
KINDS = (OVER_CONTROL, FROM_BASE)
NAMES = {OVER_CONTROL: "gain", FROM_BASE: "difference"}  # of columns
ENDS = {"": "mean", "_low": "low", "_high": "high", "_p": "p"}  # of their names: what of an interval they hold
COLUMNS = [f"{name}{end}" for name in NAMES.values() for end in ENDS]
CAPTION = (
    "Gain over control: how much lower the error is than that of the control, the same base model trained on for the "
    "same steps on the real data alone. Difference from base: how much lower it is than that of the base model, which "
    "had fewer steps: no gain of augmentation. Positive is better. Means over pairs of the same seed and the same "
    "samples with their 95 % intervals; bold: told apart from 0."
)


def references(version: str, known: Iterable[str]) -> dict[str, str]:
    """The versions with which an augmented one is compared, of those that were run, by :data:`KINDS`."""
    found, names = Version.parse(version), set(known)
    end = "".join(f"{ESTIMATOR}{one}" for one in found.estimators)
    wanted = {OVER_CONTROL: f"{found.method}{CONTROL}{end}", FROM_BASE: f"{found.method}{end}"}
    return {kind: name for kind, name in wanted.items() if name in names}


def gains(long: pd.DataFrame, samples: Samples) -> dict[tuple[str, str, str, str], Interval]:
    """Differences of one experiment by row (method and preset), kind, set and metric; positive is better.

    Arguments:
        long: rows of a table (:mod:`expertaug.evaluation.tables`) with columns experiment, preset, method, row, set and
            metric.
    """
    found = {}
    for (experiment, preset), part in long.groupby(["experiment", "preset"], sort=False):
        methods = list(dict.fromkeys(part["method"]))
        compared = {method: references(method, methods) for method in methods if Version.parse(method).is_augmented}
        for one in part[part["method"].isin(list(compared))].itertuples():
            for kind, reference in compared[one.method].items():
                keys = (experiment, preset, one.method), (experiment, preset, reference)
                interval = samples.difference(*keys, one.set, one.metric)
                if interval is not None:
                    found[one.row, kind, one.set, one.metric] = interval
    return found


def as_cell(found: Interval | None) -> Mapping | None:
    """A difference as :func:`expertaug.evaluation.formats.cell_text` prints it."""
    return found and {"mean": found.mean, "low": found.low, "high": found.high, "std": float("nan"), "n": 1, "of": 1}


def with_columns(long: pd.DataFrame, found: Mapping[tuple[str, str, str, str], Interval]) -> pd.DataFrame:
    """The rows with columns gain, gain_low, gain_high, gain_p and difference, difference_low, … where there are any."""
    keys = list(zip(long["row"], long["set"], long["metric"], strict=True))
    columns = {}
    for kind, name in NAMES.items():
        cells = [found.get((row, kind, *cell)) for row, *cell in keys]
        if any(cells):
            for end, key in ENDS.items():
                columns[f"{name}{end}"] = [float("nan") if cell is None else getattr(cell, key) for cell in cells]
    return long.assign(**columns)
