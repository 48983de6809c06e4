"""Which split each frame of a recording, or point of a trajectory, belongs to: 0 train, 1 validation, 2 test, -1 none.

What is called a frame and a recording here is a point of the grid and a trajectory of measurements of other kinds.
"""

from __future__ import annotations

import numpy as np

from expertaug.errors import InputError

SPLITS = ("train", "validation", "test")
Shares = tuple[float, float, float]  # of SPLITS, in that order


def stretches(present: np.ndarray, longest_gap: int = 0) -> list[tuple[int, int]]:
    """Runs [start, stop) of frames that are present, over gaps of at most ``longest_gap`` frames."""
    frames = np.flatnonzero(present)
    if len(frames) == 0:
        return []
    breaks = np.flatnonzero(np.diff(frames) > longest_gap + 1)
    starts = frames[np.concatenate(([0], breaks + 1))]
    stops = frames[np.concatenate((breaks, [len(frames) - 1]))] + 1
    return list(zip(starts.tolist(), stops.tolist(), strict=True))


def label_by_time(measured: np.ndarray, shares: Shares, from_end: bool = True) -> np.ndarray:
    """Split of each frame, (n,): test at the recording's start, then validation, train at its end (the paper's rule).

    Arguments:
        measured: (n,), frames that may be used.
        shares: each split's part of the recording's duration.
        from_end: False begins with train instead and ends with test.
    """
    n = len(measured)
    label = np.zeros(n, dtype=np.int8)
    if from_end:
        label[: round((shares[2] + shares[1]) * n)] = 1
        label[: round(shares[2] * n)] = 2
    else:
        label[round(shares[0] * n) :] = 1
        label[round((shares[0] + shares[1]) * n) :] = 2
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


def label_by_level(
    measured: list[np.ndarray],
    levels: list[np.ndarray],
    sizes: list[int] | None,
    shares: Shares,
    statistic: str = "mean",
    thresholds: tuple[float, float] | None = None,
    where: str = "split by energy",
) -> tuple[list[np.ndarray], dict[str, float]]:
    """Split of each frame by the mean energy, or another quantity, of its segment: low train, high test.

    Arguments:
        measured: per recording, (n,), frames that may be used.
        levels: per recording, (n,), in s⁻² if energies; NaN where not known.
        sizes: per recording, frames of a segment; None: each recording is one.
        shares: each split's part of the segments of all recordings.
        statistic: what counts of a segment's values: mean, max, min or range.
        thresholds: up to the first segments train, beyond the second they test; None: as the shares say.
        where: for messages.

    Returns:
        per recording the labels (n,), and the two thresholds.

    Raises:
        InputError: fewer than three segments.
    """
    numbers = _pieces(measured, sizes)
    means = [_of_each(number, level, statistic) for number, level in zip(numbers, levels, strict=True)]
    pooled = np.concatenate(means)
    pooled = pooled[np.isfinite(pooled)]
    if len(pooled) < 3:
        raise InputError(where, f"{len(pooled)} stretches are a chunk long", "give more or longer recordings")
    low, high = np.quantile(pooled, [shares[0], shares[0] + shares[1]]) if thresholds is None else thresholds
    labels = []
    for number, mean in zip(numbers, means, strict=True):
        of_each = np.where(np.isfinite(mean), (mean > low).astype(np.int8) + (mean > high), -1).astype(np.int8)
        labels.append(_of_frames(number, of_each))
    return labels, {"train_below": float(low), "test_above": float(high)}


def label_at_random(
    measured: list[np.ndarray], sizes: list[int] | None, shares: Shares, seed: int, where: str
) -> list[np.ndarray]:
    """Split of each frame, per recording (n,): segments drawn by ``seed``; arguments as :func:`label_by_level`.

    Of two recordings that are a piece each, one trains, and the other's halves validate and test.

    Raises:
        InputError: fewer than three segments, or one recording that is a piece.
    """
    if sizes is None and len(measured) == 2:
        trains = int(np.random.default_rng(seed).integers(2))
        return [np.where(measured[k], 0, -1) if k == trains else _in_halves(measured[k]) for k in range(2)]
    numbers = _pieces(measured, sizes)
    counts = [int(number.max(initial=-1)) + 1 for number in numbers]
    total = sum(counts)
    if total < 3:
        raise InputError(where, f"there are {total} pieces to draw from", "give more data, or shorter chunks")
    # At least one of each, and as many as the shares say.
    first = min(max(1, round(shares[0] * total)), total - 2)
    second = min(max(1, round(shares[1] * total)), total - 1 - first)
    place = np.random.default_rng(seed).permutation(total)
    drawn = ((place >= first).astype(np.int8) + (place >= first + second)).astype(np.int8)
    each = np.split(drawn, np.cumsum(counts)[:-1])
    return [_of_frames(number, of_each) for number, of_each in zip(numbers, each, strict=True)]


def _in_halves(measured: np.ndarray) -> np.ndarray:
    """Split of each frame, (n,), of a recording whose first half validates and whose second half tests."""
    label, frames = np.full(len(measured), -1, dtype=np.int8), np.flatnonzero(measured)
    label[frames] = np.where(np.arange(len(frames)) < len(frames) // 2, 1, 2)
    return label


def _pieces(measured: list[np.ndarray], sizes: list[int] | None) -> list[np.ndarray]:
    """Number of each frame's segment, per recording."""
    if sizes is None:
        return [np.where(frames, 0, -1) for frames in measured]
    return [number_segments(m, size) for m, size in zip(measured, sizes, strict=True)]


def _of_each(number: np.ndarray, level: np.ndarray, statistic: str) -> np.ndarray:
    """A statistic of the known values of each segment; NaN where there are none."""
    count, inside = int(number.max(initial=-1)) + 1, (number >= 0) & np.isfinite(level)
    place, value = number[inside], level[inside]
    present = np.bincount(place, minlength=count)
    if statistic == "mean":
        with np.errstate(invalid="ignore"):
            return np.bincount(place, weights=value, minlength=count) / present
    high, low = np.full(count, -np.inf), np.full(count, np.inf)
    np.maximum.at(high, place, value)
    np.minimum.at(low, place, value)
    of_each = {"max": high, "min": low, "range": high - low}[statistic]
    return np.where(present > 0, of_each, np.nan)


def _of_frames(number: np.ndarray, of_each: np.ndarray) -> np.ndarray:
    """Labels of segments as labels of their frames, -1 of frames without one."""
    label = np.full(len(number), -1, dtype=np.int8)
    inside = number >= 0
    label[inside] = of_each[number[inside]]
    return label


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
