"""Forecasts from the shell: a table of windows, or of measurements like the training's, in; a CSV of states out."""

from __future__ import annotations

import logging
import re
import sys
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from torch import Tensor

from expertaug import systems
from expertaug.api.arguments import Array, same_times
from expertaug.api.forecasts import Forecast, label_column
from expertaug.api.trained import TrainedModel, load
from expertaug.errors import InputError
from expertaug.files import atomic
from expertaug.measurements.settings import MeasurementSettings, column_of
from expertaug.measurements.table_files import read_table
from expertaug.measurements.windows import Windows, latest_windows, settings_of
from expertaug.systems import Parameter
from expertaug.trajectories import Trajectories

logger = logging.getLogger(__name__)
MOST_TIMES = 1_000_000
MEDIAN = "median"  # of the seeds


def forecast_file(
    model: Path,
    window: Path,
    output: Path | None = None,
    seed: int | str | None = None,
    t_end: float | None = None,
    classes: Collection[str] = (),
    refine: float | str | None = None,
    validation: Path | None = None,
    measurements: Path | None = None,
) -> None:
    """Forecast the windows of a CSV file, or the latest one of each trajectory of a table like the training's.

    Arguments:
        model: model file.
        window: CSV with a column ``t`` in s and one for each component of the state; ``sample`` tells several windows
            apart.  Headings may carry units, ``theta [rad]``.  Of a model with known inputs each is a column too, and
            rows after the observed window, without states, have the inputs at the times of the forecast.  Or a table of
            measurements, read as those of the training were: its forecasts have the trajectories' own times, and
            standard deviations over the seeds; a line for each trajectory is logged.
        output: CSV; None: standard output.  Its columns are seed, sample, ``t [s]``, the states and the estimates of
            the expert parameters, ``z_e omega0 [rad/s]``, the misfit of the window, and whether it is to be trusted.
        seed: one of the model's; median: one forecast of all (:meth:`Forecast.median`); None: each that could be
            trained.
        t_end: last time in s; beyond the training's times their last step goes on.  None: the training's last.
        classes: as of :func:`expertaug.load`.
        refine: standard deviation of the data's noise, 0 for none, or "estimated" as from the training's: estimates are
            refined by least squares on each window, and their standard deviations and χ² are columns too.  None: the
            model's own estimates.
        validation: npz of trajectories like the training's (``data/validation.npz`` of a run), from which the threshold
            of ``trusted`` comes; None: from the model file, which knows none of refined estimates.
        measurements: how tables like the training's are read (:func:`expertaug.measurements.windows.settings_of`).

    Raises:
        InputError: a file cannot be used, the window's times are not the model's, or the seed could not be trained.
    """
    trained = load(model, classes=classes)
    failed = trained.stored.failed
    usable = {number: place for place, number in enumerate(trained.seeds) if number not in failed}
    if not usable:
        raise InputError(model, "none of its seeds could be trained", "train it again")
    if isinstance(seed, int):
        if seed not in usable:
            problem = f"seed {seed} could not be trained" if seed in failed else f"no seed {seed}"
            raise InputError(model, problem, f"it has {', '.join(map(str, usable))}")
        trained = trained[usable[seed]]
    elif failed:
        logger.warning("%s: left out, since they could not be trained: seeds %s", model, ", ".join(map(str, failed)))
        trained = trained[list(usable.values())]
    if refine is not None:
        if refine != "estimated" and not 0 <= float(refine) < np.inf:
            raise InputError("--refine", f"found {refine:g}", "give the noise's standard deviation, at least 0")
        trained = trained.refined(noise=refine)  # type: ignore[arg-type]
    if validation is not None:
        trained = trained.watched(Trajectories.load(validation))
    settings = settings_of(model, measurements)
    if settings is not None and (measurements is not None or _is_like(window, settings)):
        table = _of_trajectories(trained, window, settings, t_end, seed == MEDIAN)
    else:
        names, t, y, u = read_windows(window, trained)
        if u is None:
            t = np.concatenate((t, _later(trained, t_end)))
        else:
            t, u = _read_inputs(window, trained, t, u, t_end)
        forecast = trained.forecast(y, t, u=u)
        table = (forecast.median() if seed == MEDIAN else forecast).table()
        table["sample"] = np.array(names, dtype=object)[table["sample"]]
    if output is None:
        table.to_csv(sys.stdout, index=False)
        return
    with atomic(output) as temporary:
        table.to_csv(temporary, index=False)


def _is_like(path: Path, settings: MeasurementSettings) -> bool:
    """Whether a file has the columns of the training's tables."""
    try:
        names = read_table(path, settings).names
    except InputError:
        return False
    return {column_of(column).name for column in (settings.time, *settings.columns.values())} <= set(names)


def _of_trajectories(
    model: TrainedModel, path: Path, settings: MeasurementSettings, t_end: float | None, median: bool
) -> pd.DataFrame:
    """Forecasts of the latest window of each trajectory: the columns of :meth:`Forecast.table`, of the seeds' median or
    of each; times in the trajectories' own, and the standard deviation of each state over the seeds where there are
    several."""
    windows = latest_windows([str(path)], settings, systems.names(model.system), model.t, model.observed)
    for name in windows.left_out:
        logger.warning("%s: no window as the model observes it: left out", name)
    if windows.u is None:
        t, u = np.concatenate((windows.t, _later(model, t_end))), None
    else:
        t, u = _read_inputs(path, model, windows.t, windows.u, t_end)
    forecast = model.forecast(windows.y, t, u=u)
    table = (forecast.median() if median else forecast).table()
    for name in (p.name for p in model.system.state) if len(forecast.seeds) > 1 and not median else ():
        heading = label_column(name, forecast.units[name])
        over_seeds = table.groupby(["sample", "t [s]"])[heading].transform("std")
        table.insert(
            list(table.columns).index(heading) + 1, label_column(f"{name} std", forecast.units[name]), over_seeds
        )
    for line in _describe(forecast, windows, model.observed):
        logger.info("%s", line)
    table["t [s]"] += windows.start_s[table["sample"]]
    table["sample"] = np.array(windows.names, dtype=object)[table["sample"]]
    return table


def _describe(forecast: Forecast, windows: Windows, observed: int) -> Iterator[str]:
    """For each trajectory: from when to when, its estimates, and whether to trust it."""
    seeds, several = len(forecast.seeds), len(forecast.seeds) > 1

    def of_seeds(values: Array) -> np.ndarray:
        return np.asarray(values.cpu() if isinstance(values, Tensor) else values).reshape(seeds, len(windows.names))

    for k, name in enumerate(windows.names):
        begin, end = windows.start_s[k] + forecast.t[observed - 1], windows.start_s[k] + forecast.t[-1]
        parts = [f"{name}: from {begin:.6g} to {end:.6g} s"]
        for parameter, values in forecast.z_e.items():
            each = of_seeds(values)[:, k]
            std = of_seeds(forecast.z_e_std[parameter])[:, k] if parameter in forecast.z_e_std else None
            spread = each.std(ddof=1) if several else np.nan
            error = spread if std is None else np.sqrt(np.mean(std**2) + (spread**2 if several else 0.0))
            of = f" ± {error:.2g}" if np.isfinite(error) else ""
            parts.append(f"{parameter} = {each.mean():.4g}{of} {forecast.units[f'z_e {parameter}']}".rstrip())
        if forecast.chi2 is not None:
            parts.append(f"χ² {of_seeds(forecast.chi2)[:, k].mean():.3g}")
        if forecast.p_chi2 is not None:
            parts.append(f"p {of_seeds(forecast.p_chi2)[:, k].mean():.2g}")
        if forecast.outside is not None and of_seeds(forecast.outside)[:, k].mean() >= 0.5:
            parts.append("outside the training windows' range")
        parts += [] if forecast.doubts is None else forecast.doubts.reasons(k)
        if forecast.trusted is None:
            parts.append("whether to trust it is unknown (give --validation)")
        else:
            parts.append(_verdict(int((~of_seeds(forecast.trusted)[:, k].astype(bool)).sum()), seeds))
        yield ", ".join(parts)


def _verdict(against: int, seeds: int) -> str:
    """Whether to trust a window's forecast, which a number of the seeds do not."""
    if against == 0:
        return "to be trusted"
    return "not to be trusted" + (f" ({against} of {seeds} seeds distrust it)" if seeds > 1 else "")


def read_windows(path: Path, model: TrainedModel) -> tuple[list, np.ndarray, np.ndarray, np.ndarray | None]:
    """Names of the samples (N), times (T1,) in s and states (N, T1, C) of a CSV file; of a model with known inputs the
    times (T,) may go on, and the last are the inputs at all of them, (N, T, U).

    Raises:
        InputError: no CSV, a column is missing or of another unit, a value is no number, or windows differ in times.
    """
    state, known_inputs = model.system.state, model.system.known
    if model.system.state_shape != (len(state),):
        raise InputError(path, "the model's state is a field", "forecast it in Python: expertaug.load(…).forecast(…)")
    try:
        table = pd.read_csv(path)
    except FileNotFoundError as error:
        raise InputError(path, "no such file", "give a CSV of the observed window") from error
    except (ValueError, OSError) as error:  # a broken table is a ValueError
        raise InputError(path, f"no CSV ({error})", "give columns t and the state's, separated by commas") from error
    columns = {_name(heading): heading for heading in table.columns}
    sample = table[columns["sample"]] if "sample" in columns else pd.Series(0, index=table.index)
    seen = table.groupby(sample.to_numpy(), dropna=False).cumcount().to_numpy() < model.observed
    everywhere = np.ones(len(table), dtype=bool)
    for parameter in (Parameter("t", "s"), *known_inputs, *state):
        _check_column(path, table, columns, parameter, seen if known_inputs and parameter in state else everywhere)
    windows = [part for _, part in table.groupby(sample.to_numpy(), sort=False, dropna=False)]
    times = [part[columns["t"]].to_numpy(dtype=float) for part in windows]
    for number, t in enumerate(times):
        if len(t) != len(times[0]) or np.any(t != times[0]):
            raise InputError(path, f"window {number + 1} has other times than the first", "give all the same times")
    if not windows:
        raise InputError(path, "has no rows", f"give the {model.observed} observed points")
    values = [part[[columns[p.name] for p in (*state, *known_inputs)]].to_numpy(dtype=float) for part in windows]
    y, u = np.split(np.stack(values), [len(state)], axis=2)
    if len(times[0]) != model.observed and not (known_inputs and len(times[0]) > model.observed):
        remedy = f"the model observes {model.observed}, t = {model.t[0]:g} … {model.t[model.observed - 1]:g} s"
        raise InputError(path, f"has {len(times[0])} points a window", remedy)
    same_times(times[0][: model.observed], model.t[: model.observed], str(path), "give the window at these times")
    names = [part[columns["sample"]].iloc[0] if "sample" in columns else 0 for part in windows]
    return names, times[0], y[:, : model.observed], u if known_inputs else None


def _read_inputs(
    path: Path, model: TrainedModel, t: np.ndarray, u: np.ndarray, t_end: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """The times up to ``t_end`` at which a file gives the known inputs, and these.

    Raises:
        InputError: it gives none where a forecast is wanted.
    """
    last = t[model.observed - 1]
    if t_end is not None and not last <= t_end < np.inf:
        raise InputError("--t-end", f"found {t_end:g}", f"the observed window ends at {last:g} s")
    if len(t) == model.observed if t_end is None else t[-1] < t_end - 1e-9:
        names = ", ".join(p.name for p in model.system.known)
        remedy = f"add rows with t and {names}, the states empty, up to the end of the forecast"
        raise InputError(path, f"gives {names} up to {t[-1]:g} s", remedy)
    kept = np.ones(len(t), dtype=bool) if t_end is None else t <= t_end + 1e-9
    return t[kept], u[:, kept]


def _check_column(
    path: Path, table: pd.DataFrame, columns: dict[str, str], parameter: Parameter, needed: np.ndarray
) -> None:
    """A column must be there, in the system's unit, with a finite number in each of the rows that are needed."""
    wanted = label_column(parameter.name, parameter.unit)
    if parameter.name not in columns:
        raise InputError(path, f"no column {parameter.name}", f"it has {', '.join(table.columns)}; give {wanted}")
    heading = columns[parameter.name]
    unit = re.search(r"\[(.*)\]\s*$", heading)
    if unit and unit[1].strip() != parameter.unit:
        raise InputError(path, f"column {heading}", f"the model's unit is {wanted}: convert it")
    numbers = np.asarray(pd.to_numeric(table[heading], errors="coerce"), dtype=float)
    if not np.isfinite(numbers[needed]).all():
        row = int(np.argmin(np.isfinite(numbers) | ~needed))
        raise InputError(path, f"column {heading}, row {row + 1}: {table[heading].iloc[row]}", "give finite numbers")
    table[heading] = numbers


def _name(heading: object) -> str:
    """Heading of a column without its unit."""
    return re.sub(r"\s*\[.*\]\s*$", "", str(heading)).strip()


def _later(model: TrainedModel, t_end: float | None) -> np.ndarray:
    """Times after the observed window."""
    model_times, last = model.t, model.t[model.observed - 1]
    if t_end is None:
        return model_times[model.observed :]
    if not last <= t_end < np.inf:
        raise InputError("--t-end", f"found {t_end:g}", f"the observed window ends at {last:g} s")
    step = model_times[-1] - model_times[-2]
    count = max(0, int(np.floor((t_end - model_times[-1]) / step + 1e-9)))
    if count > MOST_TIMES:
        raise InputError("--t-end", f"{t_end:g} s is {count} steps of {step:g} s", f"at most {MOST_TIMES}")
    times = np.concatenate((model_times, model_times[-1] + step * np.arange(1, count + 1)))
    return times[(times > last) & (times <= t_end + 1e-9)]
