"""Chunks: where they begin in labelled series, and how many of them are taken."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from expertaug.errors import InputError
from expertaug.measurements.settings import Cutting
from expertaug.measurements.splitting import SPLITS, stretches

MOST_LONG = 300  # chunks of a set of long ones, which overlap: more would cost more than they tell


def chunk_starts(member: np.ndarray, step: int, options: Cutting, stride: int) -> np.ndarray:
    """First rows of the chunks that lie wholly in runs of ``member`` rows, in order."""
    span = (options.length - 1) * step + 1
    starts = [np.zeros(0, dtype=int)]
    for start, stop in stretches(member):
        phases = range(step if options.phases == "all" else 1)
        starts += [np.arange(start + phase, stop - span + 1, stride * step) for phase in phases]
    return np.sort(np.concatenate(starts))


def rows_of(
    labels: Sequence[np.ndarray], steps: Sequence[int], split: str, options: Cutting, stride: int
) -> np.ndarray:
    """A split's chunks: rows (series, first row of the chunk), (N, 2).

    Arguments:
        labels: of each series, (n,): 0 train, 1 validation, 2 test, -1 none.
        steps: of each, rows from one point of a chunk to the next.
    """
    place = SPLITS.index(split)
    starts = [chunk_starts(label == place, step, options, stride) for label, step in zip(labels, steps, strict=True)]
    series = np.repeat(np.arange(len(starts)), [len(s) for s in starts])
    return np.stack((series, np.concatenate(starts)), axis=1)


def space_out(rows: np.ndarray, stride: int) -> np.ndarray:
    """Rows (series, first point) in order, without those that begin less than a stride after the last one taken."""
    taken: list[int] = []
    for k, (index, first) in enumerate(rows):
        if not taken or index != rows[taken[-1], 0] or first - rows[taken[-1], 1] >= stride:
            taken.append(k)
    return rows[taken]


def thin_out(rows: np.ndarray, limit: int | None) -> np.ndarray:
    """At most ``limit`` rows, evenly spread; None = all."""
    if limit is None or limit >= len(rows):
        return rows
    return rows[np.linspace(0, len(rows) - 1, limit).round().astype(int)]


def choose_chunks(
    where: object, candidates: dict[str, np.ndarray], options: Cutting, more: str
) -> dict[str, np.ndarray]:
    """Of each split at most as many chunks as the settings allow.

    Arguments:
        where: for messages.
        candidates: per split, rows as of :func:`rows_of`.
        more: what there should be more of, for messages.

    Raises:
        InputError: a split has too few.
    """
    for name, rows in candidates.items():
        if len(rows) < options.min_chunks:
            counts = ", ".join(f"{n} {len(of)}" for n, of in candidates.items())
            ways = f"more {more}, shorter chunks, a smaller stride or a lower min_chunks"
            remedy = f"at least {options.min_chunks} are needed: {ways}"
            raise InputError(where, f"too few chunks for the {name} split ({counts})", remedy)
    return {name: thin_out(rows, options.limit(name)) for name, rows in candidates.items()}


def stride_of(split: str, options: Cutting) -> int:
    """Points from one chunk's start to the next."""
    return options.stride if split == "train" else options.evaluation_stride
