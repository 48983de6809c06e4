"""The stage distance: error, alarms and skill as functions of how far z_e, or z_a, lies from the training range."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from expertaug import plotting
from expertaug.evaluation.alarms import KNOWN
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.intervals import Interval, Resampled, interval, log_mean, mean, units_of
from expertaug.evaluation.settings import WindowStudyJob
from expertaug.evaluation.table import DASH, Study, Table
from expertaug.evaluation.windows import VersionWindows, WindowSet, none_shown, windows_of
from expertaug.hues import FLOOR
from expertaug.inference.diagnostics.alarm import attainable, threshold
from expertaug.rows import frame, group_by
from expertaug.versions import LINES, choose_compared

SINGLE = 1e-6  # of a value: what rounding to single precision moves it by, and more
ROOM = 2.0  # of the range of the versions shown: a floor within it is in the panel
ASIDE = 0.02  # of the largest distance, between the first version's line and the last one's
WORST = -2.0  # skill below which an axis is logarithmic
BINS = 6  # of windows beyond the range, of equal numbers; those within are one
CAPTION = (
    "Distance: how far the true z_e of a window lies beyond the training range, in widths of that range, the largest "
    "over parameters; of z_a, where sets are shifted in it: the same of the interaction's parameters, over all windows "
    "whose z_e lies within. Bins of equal numbers of windows, their medians. log-MSE: natural logarithm of the mean "
    "squared error of the forecast. Skill: 1 at the floor (the equation that made the data, fitted to each window), 0 "
    "at the mean of the training set, on the scale of log-MSE. Alarms: windows whose misfit is above the 95 % "
    "threshold of the validation set. Means over seeds, and their 95 % intervals over seeds and windows."
)
METRICS = {
    "log_mse": ("log-MSE", 2),
    "parameter_error": ("parameter error [%]", 1),
    "alarms": ("alarms [%]", 1),
    "skill": ("skill", 2),
}  # of each its title and digits


@dataclass(frozen=True)
class Mean:
    """A mean over seeds with the ends of its 95 % interval, NaN where nothing is known of it."""

    value: float = np.nan
    low: float = np.nan
    high: float = np.nan

    @classmethod
    def of(cls, estimate: Interval, most: float = np.inf) -> Mean:
        """``most``: what no value exceeds."""
        return cls(estimate.mean, float(np.minimum(estimate.low, most)), float(np.minimum(estimate.high, most)))

    def text(self, digits: int) -> str:
        """As it is printed; – where it is not known."""
        if not np.isfinite(self.value):
            return DASH
        shown = [f"{round(each, digits) + 0.0:.{digits}f}" for each in (self.value, self.low, self.high)]
        ends = f" [{shown[1]}, {shown[2]}]" if np.isfinite(self.low) else ""
        return (shown[0] + ends).replace("-", "−")


@dataclass(frozen=True)
class Bin:
    """Windows of a version about as far from the training range.

    Attributes:
        distance: their median.
        windows: how many.
        log_mse, parameter_error, alarms: errors, in % of the parameters, and the share with an alarm in %; means over
            seeds, NaN where there are none.
        skill: NaN where nothing gives its scale.
        of: in what they are away, z_e or z_a.
        method, label: whose they are.
    """

    distance: float
    windows: int
    log_mse: Mean
    parameter_error: Mean
    alarms: Mean
    skill: Mean
    of: str
    method: str
    label: str


@dataclass(frozen=True)
class _Curve:
    """Bins of a version by their distance, and the log-MSE of each as resampled, which skill is made of."""

    bins: list[Bin]
    log_mse: list[Resampled]

    def __add__(self, other: _Curve) -> _Curve:
        return _Curve(self.bins + other.bins, self.log_mse + other.log_mse)

    def with_skill(self, floor: _Curve, least: _Curve) -> list[Bin]:
        """The bins with their skill from ``least`` (0) to ``floor`` (1), where these have the same bins."""
        if not len(floor.bins) == len(least.bins) == len(self.bins):
            return self.bins
        scales = zip(self.bins, self.log_mse, floor.log_mse, least.log_mse, strict=True)
        return [replace(bin_, skill=Mean.of(interval(_skill(*errors)))) for bin_, *errors in scales]


def run_stage(forecasts: Sequence[Path], outputs: Sequence[Path], job: WindowStudyJob) -> None:
    """Stage: write the table of an experiment's curves and draw them.

    Arguments:
        forecasts: forecasts.npz of all versions and groups of seeds.
        outputs: any of .csv, .md, .tex, .png and .pdf.
        job: see :func:`distance`.

    Raises:
        InputError: a file is broken, or an output's suffix is unknown.
    """
    distance(map(Forecasts.load, forecasts), job).save(outputs)


def distance(forecasts: Iterable[Forecasts], job: WindowStudyJob) -> Study:
    """The table and the figure of an experiment's curves.

    Arguments:
        forecasts: of all versions and groups of seeds, of the mean and of the true equation too where they are run:
            without them there is no skill.
        job: ``training_range`` and ``interaction_range`` of z_e and z_a; ``floor`` and ``mean``, by which skill is
            measured; ``classical``, least squares with the expert.

    Raises:
        InputError: as of :func:`windows_of`, or no version that is shown has forecasts.
    """
    versions, labels = windows_of(forecasts), job.label_of
    curved = [v for v in labels if v in versions]
    if not curved:
        raise none_shown(versions)
    nothing = _Curve([], [])
    floor, least = (
        _curves(versions[v], v, "", job) if v is not None and v in versions else nothing for v in (job.floor, job.mean)
    )
    bins = [bin_ for v in curved for bin_ in _curves(versions[v], v, labels[v], job).with_skill(floor, least)]
    title = f"{job.of_experiment(versions[curved[0]].experiment)}: distance from the training range"
    return Study(frame(Bin, bins), [_table(bins, title)], lambda: _draw(bins, job, title))


def beyond(z_e: np.ndarray, parameters: Sequence[str], ranges: Mapping[str, Sequence[float]]) -> np.ndarray:
    """How far z_e (N, P) lies beyond ranges, in their widths: (N,), 0 within; the largest over the parameters that have
    one.  What single precision has rounded out of a range, or out of one value, lies within."""
    each = [np.zeros(len(z_e))]
    for k, name in enumerate(parameters):
        if name in ranges:
            low, high = ranges[name]
            out = np.maximum(np.maximum(low - z_e[:, k], z_e[:, k] - high), 0)
            each.append(np.where(out > SINGLE * max(abs(low), abs(high)), out, 0) / max(high - low, 1e-12))
    return np.max(each, axis=0)


def _curves(version: VersionWindows, method: str, label: str, job: WindowStudyJob) -> _Curve:
    """The bins of z_e's distance and, where windows are shifted in it, of z_a's."""
    shifted = [name for name in version.sets if name not in ("train", "validation" if "iid" in version.sets else "")]
    main = [version.sets[name] for name in version.judged]
    parameter_ranges = {**job.interaction_range, **job.training_range}  # what one expert knows another leaves to F_a
    away = [beyond(s.z_e, version.parameters, parameter_ranges) for s in main]
    curve = _curve(version, ("z_e", method, label), main, away)
    ranges = job.interaction_range
    sets = [version.sets[name] for name in shifted if version.sets[name].z_a is not None]
    if set(version.interaction) == set(ranges) and ranges and sets:
        inside = [beyond(s.z_e, version.parameters, parameter_ranges) == 0 for s in sets]
        away = [beyond(s.z_a, version.interaction, ranges) for s in sets if s.z_a is not None]
        if any((far[here] > 0).any() for far, here in zip(away, inside, strict=True)):
            curve += _curve(version, ("z_a", method, label), sets, away, inside)
    return curve


def _curve(
    version: VersionWindows,
    whose: tuple[str, str, str],
    sets: Sequence[WindowSet],
    distances: Sequence[np.ndarray],
    inside: Sequence[np.ndarray] | None = None,
) -> _Curve:
    """Bins of some sets' windows by their distances (N,), of those alone that are ``inside`` (N,); ``whose``: of what,
    method and label."""
    taken = np.concatenate(inside) if inside is not None else np.full(sum(map(len, distances)), True)
    errors, misfit = (np.concatenate([getattr(s, key) for s in sets], axis=1)[:, taken] for key in ("errors", "misfit"))
    z_e, away = np.concatenate([s.z_e for s in sets])[taken], np.concatenate(distances)[taken]
    outside = away[away > 0]
    inner = np.quantile(outside, np.linspace(0, 1, BINS + 1))[1:-1] if len(outside) >= BINS else np.array([])
    edges = np.unique(np.concatenate(([0.0], inner)))
    place = np.where(away > 0, 1 + np.searchsorted(edges[1:], away, side="left"), 0)
    usual = np.nan_to_num(version.sets[KNOWN].misfit, nan=1e30)
    limits = np.array([threshold(of_seed, attainable(len(of_seed))) for of_seed in usual])[:, None]
    relative = None
    if all(s.z_e_hat is not None for s in sets):
        hat = np.concatenate([s.z_e_hat for s in sets], axis=1)[:, taken]  # type: ignore[misc]
        relative = 100 * np.abs((hat - z_e) / z_e).mean(2)
    curve = _Curve([], [])
    for k in np.unique(place):
        here = place == k
        unit = units_of(None, int(here.sum()))  # simulated windows: nobody else knows their true z_e
        log_mse = log_mean(errors[:, here], unit)
        off = Mean() if relative is None else Mean.of(interval(mean(relative[:, here], unit), not_negative=True))
        alarms = mean(100.0 * (misfit[:, here] > limits), unit)
        means = Mean.of(interval(log_mse)), off, Mean.of(interval(alarms, not_negative=True), 100.0), Mean()
        curve += _Curve([Bin(float(np.median(away[here])), len(unit), *means, *whose)], [log_mse])
    return curve


def _skill(own: Resampled, floor: Resampled, least: Resampled) -> Resampled:
    """Of every seed, and of each resample of the windows, which are the same of all three."""
    with np.errstate(divide="ignore", invalid="ignore"):
        value = (least.value.mean() - own.value) / (least.value.mean() - floor.value.mean())
        base, best = (each.drawn.mean(1, keepdims=True) for each in (least, floor))
        return Resampled(value, (base - own.drawn) / (base - best), own.units)


def _table(bins: Sequence[Bin], title: str) -> Table:
    """A part for each bin, a row for each version, a column for each metric."""
    parts = []
    for (of, distance_), part in group_by(bins, lambda bin_: (bin_.of, bin_.distance)).items():
        where = "within the range" if distance_ == 0 else f"{distance_:.2f} widths beyond it"
        rows = [
            [bin_.label, *(getattr(bin_, metric).text(digits) for metric, (_, digits) in METRICS.items())]
            for bin_ in part
        ]
        parts.append((f"{of} {where} ({part[0].windows} windows)", rows))
    return Table(["method", *(name for name, _ in METRICS.values())], parts, 1, (), title, CAPTION, "distance")


def _draw(bins: Sequence[Bin], job: WindowStudyJob, title: str) -> Figure:
    """A panel a metric, a line a version: those that people choose between."""
    floor = job.floor
    named = list(dict.fromkeys(bin_.method for bin_ in bins))
    chosen = choose_compared([v for v in named if v != floor], job.classical, LINES - (floor in named))
    drawn = [*chosen, floor] if floor in named else chosen
    colours = plotting.colours(drawn, dict(job.hues) | ({} if floor is None else {floor: FLOOR}))
    with plotting.use_style():
        shifted = list(dict.fromkeys(bin_.of for bin_ in bins))
        figure = plotting.new_figure(4.6 if len(shifted) == 1 else 7.6)
        # One distance: two rows of two panels; two distances: a column each, a row a metric.
        axes = figure.subplots(2, 2, sharex=True) if len(shifted) == 1 else figure.subplots(4, 2, sharex="col")
        panels = [axes.flat] if len(shifted) == 1 else list(axes.T)
        for of, column in zip(shifted, panels, strict=True):
            block = group_by((bin_ for bin_ in bins if bin_.of == of), lambda bin_: bin_.method)
            widest = max(bin_.distance for bin_ in bins if bin_.of == of)
            for axis, (metric, (name, _)) in zip(column, METRICS.items(), strict=True):
                for v in chosen if metric == "skill" else drawn:  # the floor's skill is 1
                    aside = ASIDE * widest * (drawn.index(v) / len(drawn) - 0.5)
                    _line(axis, block.get(v, []), metric, plotting.look(v, colours), aside)
                axis.set_ylabel(name)
                axis.grid(alpha=0.4)
                shown = [getattr(bin_, metric).value for v in chosen for bin_ in block.get(v, [])]
                _scale(axis, metric, shown, [getattr(bin_, metric).value for bin_ in block.get(floor, [])])
        for axis in axes[-1]:
            of = shifted[0] if len(shifted) == 1 else shifted[list(axes[-1]).index(axis)]
            axis.set_xlabel(f"distance of {plotting.text(of)} from the training range [range widths]")
        plotting.heading(figure, plotting.text(title))
        handles, texts = axes[0, 0].get_legend_handles_labels()
        for handle, text in zip(handles, texts, strict=True):
            handle.set_label(plotting.text(text))
        plotting.legend(figure, handles)
    return figure


def _scale(axis: Axes, metric: str, shown: Sequence[float], floor: Sequence[float]) -> None:
    """Limits by the versions that people choose between: a floor far below them is told in words, where it would leave
    them little of the panel."""
    if metric == "parameter_error":
        plotting.plain_log(axis)
    good, own = (np.array([value for value in each if np.isfinite(value)]) for each in (shown, floor))
    logarithmic = axis.get_yscale() == "log"
    good, own = (np.log(each[each > 0]) if logarithmic else each for each in (good, own))
    if not len(good):
        return
    if metric == "skill" and good.min() < WORST:
        axis.set_yscale("symlog", linthresh=1.0)
        axis.set_ylim(2 * good.min(), max(1.0, good.max()) + 0.15)
        axis.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        return
    low, high = good.min(), good.max()
    if len(own) and min(low, own.min()) > high - ROOM * ((high - low) or 1.0):
        low, high = min(low, own.min()), max(high, own.max())
    margin = 0.07 * ((high - low) or 1.0)
    limits = np.array([low - margin, high + margin])
    axis.set_ylim(*(np.exp(limits) if logarithmic else limits))
    if len(own) and own.max() < limits[0]:
        ends = np.exp([own.min(), own.max()]) if logarithmic else (own.min(), own.max())
        texts = dict.fromkeys(_plain(end) for end in ends)
        words = f"True equation: {' to '.join(texts)}"
        axis.annotate(words, (0.99, 0.03), xycoords="axes fraction", ha="right", fontsize=6.5, color="0.3")


def _plain(value: float) -> str:
    return np.format_float_positional(float(f"{value:.2g}"), trim="-").replace("-", "−")


def _line(axis: Axes, curve: Sequence[Bin], metric: str, look: plotting.Look, aside: float) -> None:
    """Means with their 95 % intervals as bars, all by so much aside that those of several versions are seen."""
    good = [(bin_.distance, getattr(bin_, metric)) for bin_ in curve if np.isfinite(getattr(bin_, metric).value)]
    if good:
        places, means = zip(*good, strict=True)
        values, lows, highs = ([getattr(each, part) for each in means] for part in ("value", "low", "high"))
        ends = plotting.whiskers(values, lows, highs)
        beside = [place + aside for place in places]
        axis.plot(beside, values, linewidth=1.2, label=curve[0].label, **look)
        if np.greater(highs, lows).any():  # an axis is not scaled by bars of no length
            axis.errorbar(beside, values, ends, fmt="none", ecolor=look["color"], elinewidth=0.6)
