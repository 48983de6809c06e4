"""Longer chunks of the validation and the test points of measurements: how far forecasts reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from expertaug.errors import InputError
from expertaug.measurements.chunks import MOST_LONG, thin_out
from expertaug.measurements.cut import Measured, candidates, divide, measure, trajectories_of
from expertaug.measurements.names import Names
from expertaug.measurements.settings import MeasurementSettings, points_in
from expertaug.measurements.splitting import SPLITS, stretches
from expertaug.trajectories import Trajectories


def cut_measured_horizon(
    files: Sequence[Path], output: str | Path, settings: MeasurementSettings, name: str, names: Names
) -> None:
    """Stage: cut a set of long chunks out of the points of a split; at most ``MOST_LONG``, evenly spread.

    Arguments:
        files: as of :func:`expertaug.measurements.stage.cut_measurements`, which divides the points in the same way.
        output: gets the set (:class:`expertaug.trajectories.Trajectories`), as that function's sets but for its times.
        settings: those of that function.
        name: which of their ``horizons`` to cut.
        names: of the system.

    Raises:
        InputError: a file cannot be used, or no stretch of the split's points is as long as that.
    """
    long_set(measure(settings.of_files(files), names), name).save(Path(output))


def long_set(data: Measured, name: str) -> Trajectories:
    """One of the ``horizons`` of measurements.

    Raises:
        InputError: it is no longer than the chunks, or no stretch of the split's points is as long.
    """
    options, source = data.settings, data.source
    here = f"{source.keys}.horizons_s"
    split, seconds = options.horizons[name]
    length = points_in(seconds, data.grid.step_s)
    if length <= options.length:
        last = (options.length - 1) * data.grid.step_s
        raise InputError(here, f"found {seconds:g}", f"chunks end at {last:g} s already")
    labels = divide(data)[0]
    long = replace(data, settings=options.model_copy(update={"length": length, "phases": "first"}), nearer=False)
    rows = candidates(long, labels)[split]
    if len(rows):
        return trajectories_of(long, thin_out(rows, MOST_LONG))
    runs = [run for label in labels for run in stretches(label == SPLITS.index(split))]
    longest = max(((b - a - 1) * data.grid.row_s for a, b in runs), default=0.0)
    problem, remedy = (
        f"no {split} chunk of {seconds:g} s",
        f"give longer {source.series}, or shorter horizons_s ([] for none)",
    )
    if longest < seconds:
        raise InputError(here, f"{problem}: the longest stretch of its {source.points} lasts {longest:.2g} s", remedy)
    remedy = "give a smaller min_seen, or shorter horizons_s ([] for none)"
    raise InputError(here, f"{problem} has {options.min_seen:g} of its values measured", remedy)
