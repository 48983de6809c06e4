"""Longer chunks of the validation and the test frames: how far forecasts reach."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from expertaug.errors import InputError
from expertaug.measurements.chunks import MOST_LONG, rows_of, thinned
from expertaug.measurements.settings import points_in
from expertaug.measurements.splitting import SPLITS, stretches
from expertaug_recordings.chunks.cut import divide, trajectories_of
from expertaug_recordings.settings import CutHorizonJob


def cut_horizon(angles: Sequence[str | Path], output: str | Path, job: CutHorizonJob) -> None:
    """Cut a set of long chunks out of the frames of a split; at most ``MOST_LONG``, evenly spread.

    Arguments:
        angles: as of :func:`expertaug_recordings.chunks.cut.split_chunks`, which divides the frames in the same way.
        output: gets the set (:class:`expertaug.trajectories.Trajectories`), as that function's sets but for its times.
        job: which set, and how the frames were divided.

    Raises:
        InputError: a bad table, or no stretch of the split's frames is as long as that.
    """
    output = Path(output)
    options = job.split
    split, seconds = options.horizons[job.set]
    long = options.model_copy(update={"length": points_in(seconds, 1 / options.rate_hz), "phases": "first"})
    division = divide(angles, output, options)
    rows = rows_of(division.labels, division.steps, split, long, options.evaluation_stride)
    if not len(rows):
        longest = max(
            (stop - start - 1) / (step * options.rate_hz)
            for label, step in zip(division.labels, division.steps, strict=True)
            for start, stop in [(0, 1), *stretches(label == SPLITS.index(split))]
        )
        found = f"no {split} chunk of {seconds:g} s: the longest stretch of its frames lasts {longest:.2g} s"
        raise InputError(output, found, "give longer recordings, or shorter data.split.horizons_s ([] for none)")
    trajectories_of(division, thinned(rows, MOST_LONG), long).save(output)
