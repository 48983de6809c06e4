"""The stage distance: error, alarms and skill as functions of how far z_e, or z_a, lies from the training range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation.alarms import KNOWN
from expertaug.evaluation.settings import WindowStudyJob
from expertaug.evaluation.table import DASH, Study, Table
from expertaug.evaluation.windows import VersionWindows, WindowSet, read_windows
from expertaug.inference.diagnostics.alarm import attainable, threshold
from expertaug.versions import compared

BINS = 6  # of windows beyond the range, of equal numbers; those within are one
CAPTION = (
    "Distance: how far the true z_e of a window lies beyond the training range, in widths of that range, the largest "
    "over parameters; of z_a, where sets are shifted in it: the same of the interaction's parameters, over all windows "
    "whose z_e lies within. Bins of equal numbers of windows, their medians. log-MSE: natural logarithm of the mean "
    "squared error of the forecast. Skill: 1 at the floor (the equation that made the data, fitted to each window), 0 "
    "at the mean of the training set, on the scale of log-MSE. Alarms: windows whose misfit is above the 95 % "
    "threshold of the validation set. Means over seeds."
)
METRICS = {
    "log_mse": "log-MSE",
    "parameter_error": "parameter error [%]",
    "alarms": "alarms [%]",
    "skill": "skill",
}


def distance(forecasts: Sequence[Path], outputs: Sequence[Path], job: WindowStudyJob) -> None:
    """Write the table of an experiment's curves and draw them.

    Arguments:
        forecasts: forecasts.npz of all versions and groups of seeds, of the mean and of the true equation too where
            they are run: without them there is no skill.
        outputs: any of .csv, .md, .tex, .png and .pdf.
        job: ``training_range`` and ``interaction_range`` of z_e and z_a; ``floor`` and ``mean``, by which skill is
            measured; ``classical``, least squares with the expert.

    Raises:
        InputError: a file is broken, or an output's suffix is unknown.
    """
    versions, labels = read_windows(forecasts), job.label_of
    known = [v for v in labels if v in versions]
    if not known:
        raise InputError(forecasts[0] if forecasts else "forecasts", "no version has windows", "evaluate them again")
    scale = (job.floor, job.mean)
    ends = [_curves(versions[v], job) if v in versions else None for v in scale]
    parts = []
    for v in known:
        curve = _curves(versions[v], job)
        floor, mean = (None if end is None or len(end) != len(curve) else end["log_mse"] for end in ends)
        if floor is not None and mean is not None:
            curve["skill"] = (mean - curve["log_mse"]) / (mean - floor)
        parts.append(curve.assign(method=v, label=labels[v]))
    long = pd.concat(parts, ignore_index=True)
    title = f"{job.of_experiment(versions[known[0]].experiment)}: distance from the training range"
    Study(long, [_table(long, title)], lambda: _draw(long, job, title)).save(outputs)


def beyond(z_e: np.ndarray, parameters: Sequence[str], ranges: Mapping[str, Sequence[float]]) -> np.ndarray:
    """How far z_e (N, P) lies beyond ranges, in their widths: (N,), 0 within; the largest over parameters."""
    each = []
    for k, name in enumerate(parameters):
        low, high = ranges[name]
        each.append(np.maximum(np.maximum(low - z_e[:, k], z_e[:, k] - high), 0) / max(high - low, 1e-12))
    return np.max(each, axis=0)


def _curves(version: VersionWindows, job: WindowStudyJob) -> pd.DataFrame:
    """A row a bin of z_e's distance and, where windows are shifted in it, of z_a's: ``of`` (z_e or z_a), distance
    (median), windows, log_mse, parameter_error, alarms."""
    known = [name for name in version.sets if name not in ("train", "validation" if "iid" in version.sets else "")]
    main = [version.sets[name] for name in version.judged]
    away = [beyond(s.z_e, version.parameters, job.training_range) for s in main]
    parts = [_curve(version, main, away).assign(of="z_e")]
    ranges = job.interaction_range
    sets = [version.sets[name] for name in known if version.sets[name].z_a is not None]
    if set(version.interaction) == set(ranges) and ranges and sets:
        inside = [beyond(s.z_e, version.parameters, job.training_range) == 0 for s in sets]
        away = [beyond(s.z_a, version.interaction, ranges) for s in sets if s.z_a is not None]
        if any((one[here] > 0).any() for one, here in zip(away, inside, strict=True)):
            parts.append(_curve(version, sets, away, inside).assign(of="z_a"))
    return pd.concat(parts, ignore_index=True)


def _curve(
    version: VersionWindows,
    sets: Sequence[WindowSet],
    distances: Sequence[np.ndarray],
    inside: Sequence[np.ndarray] | None = None,
) -> pd.DataFrame:
    """A row a bin of some sets' windows by their distances (N,), of those alone that are ``inside`` (N,)."""
    taken = np.concatenate(inside) if inside is not None else np.full(sum(map(len, distances)), True)
    errors, misfit = (np.concatenate([getattr(s, key) for s in sets], axis=1)[:, taken] for key in ("errors", "misfit"))
    z_e, away = np.concatenate([s.z_e for s in sets])[taken], np.concatenate(distances)[taken]
    outside = away[away > 0]
    inner = np.quantile(outside, np.linspace(0, 1, BINS + 1))[1:-1] if len(outside) >= BINS else np.array([])
    edges = np.unique(np.concatenate(([0.0], inner)))
    place = np.where(away > 0, 1 + np.searchsorted(edges[1:], away, side="left"), 0)
    known = version.sets[KNOWN].misfit
    limits = np.array([threshold(np.nan_to_num(one, nan=1e30), attainable(len(one))) for one in known])[:, None]
    relative = None
    if all(s.z_e_hat is not None for s in sets):
        hat = np.concatenate([s.z_e_hat for s in sets], axis=1)[:, taken]  # type: ignore[misc]
        relative = 100 * np.abs((hat - z_e) / z_e).mean(2)
    rows = []
    for k in np.unique(place):
        here = place == k
        rows.append(
            {
                "distance": float(np.median(away[here])),
                "windows": int(here.sum()),
                "log_mse": float(np.log(errors[:, here].mean(1)).mean()),
                "parameter_error": np.nan if relative is None else float(relative[:, here].mean()),
                "alarms": float(100 * (misfit[:, here] > limits).mean()),
                "skill": np.nan,
            }
        )
    return pd.DataFrame(rows)


def _table(long: pd.DataFrame, title: str) -> Table:
    """A row for each version, distance and metric, a column for each bin; a row of the distances above each block."""
    most = max(len(part) for _, part in long.groupby(["label", "of"]))
    header, rows = ["method", "", *(["within"] + [f"bin {k}" for k in range(1, most)])], []
    for of, block in long.groupby("of", sort=False):
        bins = list(dict.fromkeys(block["distance"]))
        blank = [""] * (most - len(bins))
        rows.append([f"distance of {of}", "", *("0" if d == 0 else f"{d:.2f}" for d in bins), *blank])
        for label, part in block.groupby("label", sort=False):
            cells = part.set_index("distance")
            for metric, quantity in METRICS.items():
                values = [cells[metric].get(d, np.nan) for d in bins]
                if np.isfinite(values).any():
                    digits = 1 if metric in ("parameter_error", "alarms") else 2
                    texts = [f"{v:.{digits}f}" if np.isfinite(v) else DASH for v in values]
                    rows.append([str(label), quantity, *texts, *blank])
    return Table(header, [("", rows)], 2, (), title, CAPTION, "distance")


def _draw(long: pd.DataFrame, job: WindowStudyJob, title: str) -> Figure:
    """A panel a metric, a line a version: those that people choose between."""
    floor = job.floor
    named = list(dict.fromkeys(long["method"]))
    chosen = compared([v for v in named if v != floor], job.classical)
    colours = plotting.colours(chosen, job.all_methods)
    with plotting.styled():
        shifted = list(dict.fromkeys(long["of"]))
        figure = plotting.new_figure(4.6 if len(shifted) == 1 else 7.6)
        # One distance: two rows of two panels; two distances: a column each, a row a metric.
        axes = figure.subplots(2, 2, sharex=True) if len(shifted) == 1 else figure.subplots(4, 2, sharex="col")
        panels = [axes.flat] if len(shifted) == 1 else list(axes.T)
        for of, column in zip(shifted, panels, strict=True):
            block = long[long["of"] == of]
            for axis, (metric, name) in zip(column, METRICS.items(), strict=True):
                for v in chosen:
                    _line(axis, block[block["method"] == v], metric, _look(v, colours))
                if floor in named and metric != "skill":
                    look = {"color": "0.55", "linestyle": ":", "linewidth": 1.2, "label": "True equation"}
                    _line(axis, block[block["method"] == floor], metric, look)
                axis.set_ylabel(name)
                axis.grid(alpha=0.4)
                if metric == "parameter_error":
                    plotting.log_scaled(axis)
                if metric == "skill":
                    axis.set_ylim(-0.5, 1.15)
        for axis in axes[-1]:
            of = shifted[0] if len(shifted) == 1 else shifted[list(axes[-1]).index(axis)]
            axis.set_xlabel(f"{plotting.text(of)} beyond the training range [its widths]")
        plotting.heading(figure, plotting.text(title))
        handles, texts = axes[0, 0].get_legend_handles_labels()
        for handle, text in zip(handles, texts, strict=True):
            handle.set_label(plotting.text(text))
        plotting.legend(figure, handles)
    return figure


def _look(version: str, colours: Mapping) -> dict:
    return {
        "color": colours[version],
        "linestyle": plotting.dash(version),
        "marker": plotting.marker(version),
        "markersize": 3,
        "linewidth": 1.2,
    }


def _line(axis: Axes, part: pd.DataFrame, metric: str, look: Mapping) -> None:
    good = part[np.isfinite(part[metric])]
    if len(good):
        axis.plot(good["distance"], good[metric], **{"label": str(part["label"].iloc[0]), **look})
