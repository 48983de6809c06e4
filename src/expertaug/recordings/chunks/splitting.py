"""Which split each frame of a recording belongs to: 0 train, 1 validation, 2 test, -1 none."""

from __future__ import annotations

import numpy as np

from expertaug.errors import InputError
from expertaug.recordings.angles.smoothing import stretches

SPLITS = ("train", "validation", "test")
Shares = tuple[float, float, float]  # of SPLITS, in that order


def label_by_time(measured: np.ndarray, shares: Shares) -> np.ndarray:
    """Split of each frame, (n,): test at the recording's start, then validation, train at its end (the paper's rule).

    Arguments:
        measured: (n,), frames that may be used.
        shares: each split's part of the recording's duration.
    """
    n = len(measured)
    label = np.zeros(n, dtype=np.int8)
    label[: round((shares[2] + shares[1]) * n)] = 1
    label[: round(shares[2] * n)] = 2
    label[~measured] = -1
    return label


def number_segments(measured: np.ndarray, size: int) -> np.ndarray:
    """Number of each frame's segment, (n,), -1 where there is none: stretches of measured frames cut into segments.

    The frames that are left over at a stretch's end belong to its last segment.

    Arguments:
        measured: (n,), frames that may be used.
        size: frames of a segment.
    """
    number, count = np.full(len(measured), -1), 0
    for start, stop in stretches(measured):
        segments = (stop - start) // size
        if segments:
            number[start:stop] = count + np.minimum(np.arange(stop - start) // size, segments - 1)
            count += segments
    return number


def label_by_energy(
    measured: list[np.ndarray], energies: list[np.ndarray], sizes: list[int], shares: Shares
) -> tuple[list[np.ndarray], dict[str, float]]:
    """Split of each frame by the mean energy of its segment: low train, high test.

    Arguments:
        measured: per recording, (n,), frames that may be used.
        energies: per recording, (n,), in s⁻².
        sizes: per recording, frames of a segment.
        shares: each split's part of the segments of all recordings.

    Returns:
        per recording the labels (n,), and the two thresholds in s⁻².

    Raises:
        InputError: fewer than three segments.
    """
    numbers = [number_segments(m, size) for m, size in zip(measured, sizes, strict=True)]
    means = []
    for number, level in zip(numbers, energies, strict=True):
        inside = number >= 0
        means.append(np.bincount(number[inside], weights=level[inside]) / np.bincount(number[inside]))
    pooled = np.concatenate(means)
    if len(pooled) < 3:
        raise InputError(
            "split by energy", f"{len(pooled)} stretches are a chunk long", "give more or longer recordings"
        )
    low, high = np.quantile(pooled, [shares[0], shares[0] + shares[1]])
    labels = []
    for number, mean in zip(numbers, means, strict=True):
        label = np.full(len(number), -1, dtype=np.int8)
        inside = number >= 0
        label[inside] = ((mean > low).astype(np.int8) + (mean > high))[number[inside]]
        labels.append(label)
    return labels, {"train_below": float(low), "test_above": float(high)}


def keep_apart(label: np.ndarray, guard: int) -> np.ndarray:
    """The labels without the ``guard`` frames on either side of each change from one split to another.

    A smoothed angle rests on its neighbours: without a guard, chunks at a border would share labels of the same frames.
    """
    label = label.copy()
    frames = np.flatnonzero(label >= 0)
    for change in np.flatnonzero(np.diff(label[frames]) != 0):
        before, after = frames[change], frames[change + 1]
        label[max(0, before - guard + 1) : before + 1] = -1
        label[after : after + guard] = -1
    return label
