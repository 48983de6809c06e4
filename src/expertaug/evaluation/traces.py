"""Figures over time: forecasts against the truth, of a state of components or of fields, and the course of a
training."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.settings import FigureReading
from expertaug.tracking.log import Log
from expertaug.versions import Version, choose_paired, order_versions

TRUTH = {"color": "0.75", "linewidth": 3.2}  # wide and below all forecasts, so that one right above it is seen
MOST_DIMENSIONS = 4
SEEN = 0.04  # of an axis: a band that is narrower lies below its line
CURVE_POINTS = 150
# A forecast may run away; the axis shows the truth's range and this share of it on each side.
ROOM = 0.5
# Of fields.
TIMES = 4
GAP = 0.25  # between states and errors, in widths of a panel
COLOURS = "RdBu_r"
OVERSHOOT = 0.1  # of the truth's range that the colours reach beyond it
QUANTILE = 99.0  # of the errors that their colours reach to: one forecast that runs away would hide all others
METRICS = {"loss": "training loss", "validation_score": "selection score"}
PLAIN = FigureReading(labels=[])


@dataclass(frozen=True)
class View:
    """Which forecasts a figure shows.

    Attributes:
        set: of which set.
        samples: positions among those kept; empty: the first three, of fields the one whose z_e is farthest outside the
            training set's range.
        seed: whose; None: the first that could be trained.
        measured: whether the states were measured, not simulated.
    """

    set: str = "test"
    samples: Sequence[int] = ()
    seed: int | None = None
    measured: bool = False


def forecasts(
    forecasts: Mapping[str, Forecasts],
    reading: FigureReading = PLAIN,
    view: View | None = None,
    names: Mapping[str, str | Path] | None = None,
) -> Figure:
    """The forecasts of several methods for the same samples: a row per state dimension, a column per sample.

    Arguments:
        forecasts: by method; all of one experiment.
        view: which of them.
        names: what messages call each method's; None: the files that they are from.

    Raises:
        InputError: there are none, some are of other samples than the first ones, or lack the set, the seed or a
            sample.
    """
    if not forecasts:
        raise InputError("forecasts", "no file", "at least one forecasts.npz")
    view = view or View()
    names = names or {method: data.path or f"forecasts of {method}" for method, data in forecasts.items()}
    methods, name = order_versions(forecasts, dict(reading.hues)), view.set
    by_method = {method: forecasts[method] for method in methods}
    first = by_method[methods[0]]
    _check_same(names, by_method, name)
    truth, count = first.kept[name].truth, len(first.kept[name].index)
    samples = view.samples or list(range(min(3, count)))
    if max(samples) >= count:
        raise InputError(names[methods[0]], f"no sample {max(samples)}", f"it keeps {count}")
    seed = _first_trained(by_method) if view.seed is None else view.seed
    places = {method: _seed_position(names[method], by_method[method], seed) for method in methods}
    if truth.ndim > 3:  # a state with other axes than its components
        return _draw_fields(by_method, reading, view, seed)
    size = truth.shape[-1]
    spread = np.linspace(0, size - 1, min(size, MOST_DIMENSIONS)).astype(int)
    dimensions = list(dict.fromkeys(spread.tolist()))
    colours = plotting.colours(methods, dict(reading.hues))
    gaps = bool(np.isnan(truth).any())  # a point between two of them is no line
    with plotting.use_style():
        figure = plotting.new_figure(0.85 + 1.25 * len(dimensions), min(plotting.WIDTH, 2.2 + 2.0 * len(samples)))
        grid = figure.subplots(len(dimensions), len(samples), squeeze=False, sharex=True, sharey="row")
        for row, dimension in enumerate(dimensions):
            for axis, sample in zip(grid[row], samples, strict=True):
                axis.axvspan(first.t[0], first.t[first.observed], color="0.92", linewidth=0, zorder=0)
                axis.plot(first.t, truth[sample, :, dimension], marker="." if gaps else "", zorder=2, **TRUTH)
                for method in methods:
                    kept, place = by_method[method].kept[name], places[method]
                    order = 4 if Version.parse(method).is_augmented else 3
                    line = {"linewidth": 1.2, "zorder": order, **_look(method, colours)}
                    axis.plot(first.t, kept.prediction[place, sample, :, dimension], **line)
                    if kept.band is not None:
                        low, high = kept.band[:, place, sample, :, dimension]
                        times = first.t[len(first.t) - len(low) :]
                        axis.fill_between(times, low, high, color=colours[method], alpha=0.2, linewidth=0, zorder=1)
                if row == 0:
                    axis.set_title(", ".join(_parameters_of(first, name, sample)[:2]), fontsize=7.5)
                if row == len(dimensions) - 1:
                    axis.set_xlabel("t [s]")
            grid[row, 0].set_ylim(*_limits(grid[row], truth[samples][:, :, dimension]))
            grid[row, 0].set_ylabel(plotting.quantity(first.state_names[dimension], first.state_units[dimension]))
        grid[0, 0].set_xlim(first.t[0], first.t[-1])
        figure.align_ylabels(grid[:, 0])
        what = "measured" if gaps or view.measured else "truth"
        handles = [Line2D([], [], label=what, **TRUTH)]
        handles += _handles(methods, reading.label_of, colours)
        handles.append(Patch(facecolor="0.92", label="observed window"))
        for method in methods:
            if _is_seen(by_method[method].kept[name].band, places[method], samples, dimensions, grid[:, 0]):
                label = f"90 % band of {reading.printed(method)}"
                handles.append(Patch(facecolor=colours[method], alpha=0.2, label=label))
        plotting.legend(figure, handles)
        title = plotting.text(f"{_title(first, reading)}forecasts on the {reading.of_set(name)} set, seed {seed}")
        plotting.heading(figure, title)
    return figure


def _draw_fields(by_method: Mapping[str, Forecasts], reading: FigureReading, view: View, seed: int) -> Figure:
    """Draw one sample's first component: a row for the truth and for each method, a column per time; beside them what
    each forecast is off by, on a scale of its own, and the root mean square of that over the whole forecast.
    """
    methods, name = choose_paired(by_method), view.set
    first = by_method[methods[0]]
    sample = farthest(first, name, view.samples or range(len(first.kept[name].index)))
    times = np.linspace(0, len(first.t) - 1, min(TIMES, len(first.t))).round().astype(int)
    later = [k for k in times if k > first.observed]
    truth = first.kept[name].truth[sample, :, 0]
    states = {m: by_method[m].kept[name].prediction[by_method[m].seeds.index(seed), sample, :, 0] for m in methods}
    errors = [values - truth for values in states.values()]
    with plotting.use_style():
        side = (plotting.WIDTH - 1.3) / (len(times) + len(later) + GAP)
        figure = plotting.new_figure(1.4 + side * (1 + len(methods)))
        figure.get_layout_engine().set(h_pad=0.03, w_pad=0.03, hspace=0, wspace=0)
        widths = [1] * len(times) + [GAP] + [1] * len(later)
        grid = figure.subplots(1 + len(methods), len(widths), squeeze=False, width_ratios=widths)
        left, right = grid[:, : len(times)], grid[1:, len(times) + 1 :]
        for axis in (*grid[:, len(times)], *grid[0, len(times) + 1 :]):
            axis.set_axis_off()
        image = _draw_all(left, [[row[k] for k in times] for row in (truth, *states.values())], _colour_limits(truth))
        for axis, k in zip(left[0], times, strict=True):
            axis.set_title(f"t = {first.t[k]:.3g} s\n{'observed' if k <= first.observed else 'forecast'}", fontsize=7)
        rms = [f"\n{_rms(error[first.observed + 1 :]):.2g}" for error in errors]
        quantity = plotting.quantity(first.state_names[0], first.state_units[0])
        truth_name = f"truth\n{quantity}" if truth.ndim == 2 else "truth"  # a colour bar has it of images
        names = [truth_name, *(plotting.text(reading.printed(m)) + off for m, off in zip(methods, rms, strict=True))]
        for axis, words in zip(left[:, 0], names, strict=True):
            axis.set_ylabel(words, rotation=0, ha="right", va="center", labelpad=6)
        if image is not None:
            figure.colorbar(image, ax=left, location="bottom", shrink=0.7, aspect=28, label=quantity, extend="both")
        if later:
            shown = [[error[k] for k in later] for error in errors]
            finite = np.abs(shown)[np.isfinite(shown)]
            most = (float(np.percentile(finite, QUANTILE)) if finite.size else 0.0) or 1.0
            image = _draw_all(right, shown, (-most, most))
            for axis, k in zip(grid[0, len(times) + 1 :], later, strict=True):
                head = f"t = {first.t[k]:.3g} s\nerror"
                axis.text(0.5, 0.02, head, ha="center", va="bottom", fontsize=7, transform=axis.transAxes)
            if image is not None:
                label = f"{quantity}, forecast − truth"
                figure.colorbar(image, ax=right, location="bottom", shrink=0.8, aspect=22, label=label, extend="both")
        sampled = f"a sample of the {reading.of_set(name)} set ({', '.join(_parameters_of(first, name, sample))})"
        plotting.heading(figure, f"{plotting.text(_title(first, reading))}{sampled}, seed {seed}")
    return figure


def _is_seen(
    band: np.ndarray | None, place: int, samples: Sequence[int], dimensions: Sequence[int], axes: Sequence[Axes]
) -> bool:
    """Whether a band is wide enough to be seen beside a line, on the axis of any row."""
    if band is None:
        return False
    widths = np.diff(band[:, place][:, list(samples)], axis=0)[0]
    return any(
        bool(np.nanmax(widths[..., dimension], initial=0.0) > SEEN * np.ptp(axis.get_ylim()))
        for dimension, axis in zip(dimensions, axes, strict=True)
    )


def _title(data: Forecasts, reading: FigureReading) -> str:
    """The experiment's name before what a figure shows; nothing of a file that does not say it."""
    return f"{reading.of_experiment(data.version.experiment)}: " if data.version is not None else ""


def farthest(data: Forecasts, name: str, samples: Sequence[int]) -> int:
    """The sample whose z_e lies farthest outside the training set's range, in units of it; the first where none does.

    Chosen by its parameters alone, not by how well anything forecasts it.
    """
    if "train" not in data.truths:
        return samples[0]
    low, high = data.truths["train"].min(0), data.truths["train"].max(0)
    z_e = data.truths[name][data.kept[name].index[list(samples)]]
    outside = np.maximum(0, np.maximum(low - z_e, z_e - high)) / np.where(high > low, high - low, 1)
    return samples[int(outside.sum(-1).argmax())]


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.square(error, dtype=float).mean()))


def _colour_limits(truth: np.ndarray) -> tuple[float, float]:
    """Of the colours, with white at zero where zero is inside, or of lines (T, cells): the truth's range and some
    room."""
    low, high = float(truth.min()), float(truth.max())
    if low < 0 < high and truth.ndim > 2:
        low, high = -max(-low, high), max(-low, high)
    room = OVERSHOOT * ((high - low) or 1.0)
    return low - room, high + room


def _draw_all(axes: np.ndarray, rows: Sequence[Sequence[np.ndarray]], limits: tuple[float, float]) -> AxesImage | None:
    """Draw a field on each of the axes (rows, columns); the last image, None where fields are lines, which have numbers
    beside the first of each row."""
    image = None
    for line, row in zip(axes, rows, strict=True):
        for axis, field in zip(line, row, strict=True):
            image = _draw(axis, field, limits)
        if image is None:
            line[0].yaxis.set_major_locator(MaxNLocator(3))
            line[0].tick_params(labelsize=6)
    return image


def _draw(axis: Axes, field: np.ndarray, limits: tuple[float, float]) -> AxesImage | None:
    """A field over one axis as a line, over two as an image, over more by its middle slice."""
    while field.ndim > 2:
        field = field[len(field) // 2]
    axis.set(xticks=[], yticks=[])
    if field.ndim == 1:
        axis.plot(field, color="0.1")
        axis.set_ylim(*limits)
        return None
    for side in axis.spines.values():
        side.set_visible(False)
    return axis.imshow(field, vmin=limits[0], vmax=limits[1], cmap=COLOURS, interpolation="nearest")


def curves(logs: Iterable[Log], reading: FigureReading = PLAIN, traced: Sequence[str] = ()) -> Figure:
    """The course of trainings: mean over seeds as a line, all seeds as a band; a row per experiment.  One of a single
    logged step is none.  Where nothing is trained the figure says so.

    Arguments:
        logs: of every method and group of seeds.
        reading: its labels are those of the logs.
        traced: the versions to draw; none = all.

    Raises:
        InputError: no log holds any of the metrics.
    """
    labels: dict[str, str] = {}
    experiments: dict[str, dict[str, list[Log]]] = {}
    # The scores of flows are densities.
    read = [log for log in logs if not Version.parse(log.header.method).is_flow]
    if not read:
        return plotting.note("no method is trained by gradient steps")
    trained = {log.header.method for log in read}
    shown = trained & set(traced or trained) or trained
    for log in (log for log in read if log.header.method in shown):
        labels[log.header.method] = log.header.label
        experiments.setdefault(log.header.experiment, {}).setdefault(log.header.method, []).append(log)
    logged = {
        key
        for group in experiments.values()
        for logs in group.values()
        for log in logs
        for s in log.steps
        for key in s.metrics
    }
    metrics = {key: title for key, title in METRICS.items() if key in logged}
    if not metrics:
        raise InputError("logs", "none of them has the metrics", f"trainings log {', '.join(METRICS)}")
    methods = order_versions(labels, dict(reading.hues))
    colours = plotting.colours(methods, dict(reading.hues))
    with plotting.use_style():
        figure = plotting.new_figure(0.6 + 2.1 * len(experiments), plotting.WIDTH)
        grid = figure.subplots(len(experiments), len(metrics), squeeze=False)
        drawn = set()
        for row, (experiment, group) in enumerate(experiments.items()):
            for axis, (metric, title) in zip(grid[row], metrics.items(), strict=True):
                for method in methods:
                    if method in group and _curve(axis, group[method], metric, _look(method, colours)):
                        drawn.add(method)
                _scale(axis)
                axis.set(
                    title=reading.of_experiment(experiment) if len(experiments) > 1 else "", xlabel="step", ylabel=title
                )
                axis.grid(axis="y")
        handles = _handles([method for method in methods if method in drawn], labels, colours)
        handles.append(Patch(facecolor="0.85", label="range over seeds (line: mean)"))
        plotting.legend(figure, handles)
        if len(experiments) == 1:
            plotting.heading(figure, plotting.text(reading.of_experiment(next(iter(experiments)))))
    return figure


def _limits(axes: Sequence[Axes], truth: np.ndarray) -> tuple[float, float]:
    """All curves, but not far beyond the truth where one runs away."""
    drawn = np.concatenate([line.get_ydata() for axis in axes for line in axis.lines])
    drawn, truth = drawn[np.isfinite(drawn)], truth[np.isfinite(truth)]
    if not len(truth):  # of a component that nobody measured
        truth = drawn if len(drawn) else np.array([0.0, 1.0])
        drawn = truth
    room = ROOM * (np.ptp(truth) or 1.0)
    low, high = max(drawn.min(), truth.min() - room), min(drawn.max(), truth.max() + room)
    margin = 0.06 * ((high - low) or 1.0)
    return low - margin, high + margin


def _curve(axis: Axes, logs: Sequence[Log], metric: str, look: plotting.Look) -> bool:
    """Groups of seeds of one method side by side; a long course is averaged in bins.  Whether there is one."""
    by_step: dict[int, list[float]] = {}
    for log in logs:
        for line in log.steps:
            if metric in line.metrics:
                values = line.metrics[metric]
                by_step.setdefault(line.step, []).extend(values if isinstance(values, tuple) else [values])
    widest = max(map(len, by_step.values()), default=0)
    steps = np.array(sorted(step for step, values in by_step.items() if len(values) == widest))
    if len(steps) < 2:
        return False
    values = np.array([by_step[step] for step in steps])
    values[~np.isfinite(values)] = np.nan
    size = -(-len(steps) // CURVE_POINTS)
    edges = np.arange(0, len(steps), size)
    counts = np.diff(np.append(edges, len(steps)))
    steps = np.add.reduceat(steps, edges) / counts
    values = np.add.reduceat(values, edges) / counts[:, None]
    if widest > 1:
        axis.fill_between(steps, values.min(1), values.max(1), color=look["color"], alpha=0.25, linewidth=0)
    axis.plot(steps, values.mean(1), linewidth=1.3, **look)
    return True


def _scale(axis: Axes) -> None:
    """A logarithmic axis where values span more than a factor of 30, linear about zero where some are not positive."""
    values = np.concatenate([line.get_ydata() for line in axis.lines] or [np.array([])])
    values = values[np.isfinite(values)]
    if len(values) and values.min() > 0 and values.max() / values.min() > 30:
        axis.set_yscale("log")
    elif len(values) and values.min() <= 0 and values.max() > 30 * (typical := max(np.median(np.abs(values)), 1.0)):
        axis.set_yscale("symlog", linthresh=10 ** np.round(np.log10(typical)))  # ticks within the linear part collide


def _parameters_of(data: Forecasts, name: str, sample: int) -> list[str]:
    """The expert parameters of a kept sample of a set, as far as they are known."""
    values = data.truths[name][data.kept[name].index[sample]]
    described = zip(data.parameter_names, data.parameter_units, values, strict=True)
    return [
        f"{plotting.symbol(p)} = {value:.3g} {unit}".strip().replace("-", "−")
        for p, unit, value in described
        if np.isfinite(value)
    ]


def _check_same(paths: Mapping[str, str | Path], by_method: Mapping[str, Forecasts], name: str) -> None:
    first_method, first = next(iter(by_method.items()))
    for method, data in by_method.items():
        if name not in data.kept:
            raise InputError(paths[method], f"no set {name!r}", f"it has {', '.join(data.kept)}")
        kept, other = data.kept[name], first.kept[name]
        if kept.truth.shape != other.truth.shape or not np.array_equal(kept.index, other.index):
            raise InputError(
                paths[method], f"other samples than {paths[first_method]}", "evaluate both on the same data"
            )


def _seed_position(path: object, data: Forecasts, seed: int) -> int:
    if seed not in data.seeds:
        raise InputError(path, f"no seed {seed}", f"it has {', '.join(map(str, data.seeds))}")
    return data.seeds.index(seed)


def _first_trained(by_method: Mapping[str, Forecasts]) -> int:
    """The first seed that could be trained in every file; where there is none the first."""
    first = next(iter(by_method.values()))
    failed = {seed for data in by_method.values() for seed in data.failed}
    return next((seed for seed in first.seeds if seed not in failed), first.seeds[0])


def _handles(methods: Sequence[str], labels: Mapping[str, str], colours: plotting.Colours) -> list[Line2D]:
    """Entries of a legend."""
    return [Line2D([], [], label=labels.get(m, m), **_look(m, colours)) for m in methods]


def _look(version: str, colours: plotting.Colours) -> plotting.Look:
    """Of a line through so many points that none is marked."""
    return {**plotting.look(version, colours), "marker": ""}
