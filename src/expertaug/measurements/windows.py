"""Windows that a trained model observes, from tables like those that it learned from."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from expertaug.errors import InputError
from expertaug.measurements.cut import candidates, measure, trajectories_of
from expertaug.measurements.names import Names
from expertaug.measurements.settings import MeasurementSettings

REPORT = "splits.json"  # of a run's data, which keeps how its measurements were read
KEPT = "measurements"  # the key of that file


@dataclass(frozen=True)
class Windows:
    """The latest window of each trajectory.

    Attributes:
        names: of the trajectories, N.
        start_s: time of each window's first point in its trajectory's own time, (N,).
        t: times from there on in s: of the observed points (T1,), or, of a driven system, of all (T,).
        y: states (N, T1, K), NaN where nothing was measured.
        u: known inputs (N, T, U), or None.
        left_out: trajectories without such a window.
    """

    names: list[str]
    start_s: np.ndarray
    t: np.ndarray
    y: np.ndarray
    u: np.ndarray | None
    left_out: list[str]


def latest_windows(
    paths: Sequence[str], settings: MeasurementSettings, names: Names, t: np.ndarray, observed: int
) -> Windows:
    """The last window of each trajectory that chunks could have, at the model's times.

    Arguments:
        settings: how the tables are read: those of the training.
        names: of the model's system.
        t: the model's times in s, (T,).
        observed: points of the observed window, T1.

    Raises:
        InputError: a table cannot be read so, or no trajectory has such a window.
    """
    driven = bool(names.inputs)
    points = len(t) if driven else observed
    read = _as_windows(settings, paths, points, float(t[1] - t[0]), driven)
    data = measure(read, names)
    rows = candidates(data, [np.where(trajectory.usable, 0, -1) for trajectory in data.grid.series])["train"]
    latest = np.array([rows[rows[:, 0] == k][-1] for k in np.unique(rows[:, 0])], dtype=int).reshape(-1, 2)
    series = data.grid.series
    if not len(latest):
        needed = f"{points} points {data.grid.step_s:.6g} s apart, of which {read.min_seen:g} was measured"
        raise InputError(paths[0], "no trajectory has a window as the model observes it", f"it needs {needed}")
    data.warn_of_late([latest])
    windows = trajectories_of(data, latest)
    left_out = [trajectory.name for k, trajectory in enumerate(series) if k not in latest[:, 0]]
    start = np.array([series[k].t[first] for k, first in latest])
    u = None if windows.u is None else np.asarray(windows.u)
    return Windows(
        [series[k].name for k, _ in latest], start, t[:points], np.asarray(windows.seen)[:, :observed], u, left_out
    )


def _as_windows(
    settings: MeasurementSettings, paths: Sequence[str], points: int, step_s: float, driven: bool
) -> MeasurementSettings:
    """The settings of the training for windows instead of chunks; what only labels and divides is left out."""
    keys = settings.to_json() | {"paths": list(paths), "length": points, "stride": 1, "evaluation_stride": 1}
    keys |= {"min_chunks": 1, "max_chunks": None, "horizons_s": [], "phases": "all", "checksums": None, "z_e": {}}
    keys |= {"step_s": step_s} | ({"min_seen": 0.0} if driven else {})  # rows to come have inputs and no states
    return MeasurementSettings.from_mapping({k: v for k, v in keys.items() if k != "split"})


def settings_of(model: Path, source: Path | None) -> MeasurementSettings | None:
    """How the tables of a model's training were read; None where that is not known.

    Arguments:
        model: the model's file; the run that trained it has its data beside it.
        source: a run's ``data/splits.json``, or a configuration with one experiment of measurements.

    Raises:
        InputError: the source has no such settings.
    """
    if source is None:
        near = [folder / "data" / REPORT for folder in model.resolve().parents[:4]]
        reports = [path for path in near if path.is_file()]
        return _read_kept(reports[0]) if reports else None
    if source.suffix == ".json":
        settings = _read_kept(source)
        if settings is None:
            raise InputError(source, f"has no key {KEPT}", "give splits.json of a run's data, or its configuration")
        return settings
    try:
        config = yaml.safe_load(source.read_text(encoding="utf-8"))
        experiments = [
            experiment["data"]["files"]
            for experiment in config["experiments"].values()
            if "files" in experiment.get("data", {})
        ]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, AttributeError, KeyError, TypeError) as error:
        raise InputError(source, f"no configuration ({error})", "give splits.json of a run's data") from error
    if len(experiments) != 1:
        problem = f"{len(experiments)} experiments have measurements in files"
        raise InputError(source, problem, "give splits.json of the run's data")
    return MeasurementSettings.from_mapping(experiments[0])


def _read_kept(report: Path) -> MeasurementSettings | None:
    try:
        content = json.loads(report.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(report, f"cannot be read ({error})", "cut the measurements again") from error
    kept = content.get(KEPT) if isinstance(content, Mapping) else None
    return None if kept is None else MeasurementSettings.from_mapping(kept, str(report))
