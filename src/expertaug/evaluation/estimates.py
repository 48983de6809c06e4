"""The stage estimates: the parameters that each version states, with intervals: of all windows, and of each trajectory.

A trajectory's windows are averaged with weights 1 / (σ² + τ²), σ the standard deviation that a window's estimate states
and τ what the windows scatter beyond it (DerSimonian & Laird 1986).  The error of the mean follows from how blocks of
successive windows scatter, as long as the estimates' correlation time says (Geyer 1992), since windows overlap and
residuals last.  Trajectories are averaged in the same way, and the scatter beyond their errors is the population's
spread; its mean has Student's t intervals (Hartung & Knapp 2001).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from scipy import stats

from expertaug import plotting
from expertaug.evaluation.forecasts import SHARED, ConstantEstimate, Forecasts
from expertaug.evaluation.settings import EstimatesJob
from expertaug.evaluation.summary import order_sets
from expertaug.evaluation.table import DASH, Study, Table
from expertaug.inference.pooling import Pooled, pool
from expertaug.models.settings import TOLD
from expertaug.rows import frame, group_by
from expertaug.trajectories import places_by_trajectory
from expertaug.versions import choose_compared

LEVEL = 0.90  # of the intervals
BLOCKS, ENOUGH = 10, 5  # of a trajectory's windows, at most, and for an error by their scatter
FEWEST = 6  # windows of which a correlation time can be estimated
MOST_OPEN = 0.2  # share of the windows that leave a parameter open by themselves, for their mean to be told
ALL = "all"
MOST = 24  # lines of a parameter's panel; of more, some are left out
LINE = 0.17  # inches
SMALL = 6.5  # font size of the names
TICKS = 5  # at most: estimates have many digits
EMPTY = "No version states parameters that are constants of an apparatus."
CAPTION = (
    "Estimates of the parameters with their standard error and 90 % interval. Shared: one value for all windows, "
    "fitted to the training windows together, with errors clustered by trajectory, or by blocks of windows of few; "
    "constants of sensors (measured = offset + scale · (y + quadratic · y² + cubic · y³)) with them. Population: "
    "middle (of a lognormal one the median) and spread of a parameter's distribution over the training windows or "
    "trajectories. Of a trajectory: where its training windows share the parameter, their joint estimate; else the "
    "mean of its windows' own estimates in all sets (at most 200 of the training set), weighted by their errors, "
    "with the error that blocks of successive windows tell. Of all: mean over trajectories, or over windows where "
    "each is a trajectory, and the spread between them beyond their errors. Told: the interval is narrower than half "
    "the range of p⁺, in which fits start, and at most a fifth of the windows leave the parameter open by "
    "themselves; no, the data do not tell it, and windows count alike. Intervals widen with the size and the "
    "correlation of residuals. Of several seeds the mean, with their spread in the error."
)


@dataclass(frozen=True)
class Estimate:
    """A parameter, as a version states it.

    Attributes:
        parameter, unit: which one.
        of: all windows (shared), all, or a trajectory's name.
        value, error: in its unit, with the standard error; NaN where nothing says how large it is.
        low, high: ends of the 90 % interval.
        spread: standard deviation between trajectories or windows beyond their errors; NaN of a single one.
        windows: how many it is from.
        groups: how many of them count as independent by their scatter; 1 where the error is what they state themselves.
        told: whether the data tell it; None where no p⁺ says how wide an interval may be.
    """

    parameter: str
    unit: str
    of: str
    value: float
    error: float
    low: float
    high: float
    spread: float
    windows: int
    groups: int
    told: bool | None


@dataclass(frozen=True)
class OfVersion:
    """What a row of the table begins with: the version's name, and what is printed for it."""

    method: str
    label: str


@dataclass(frozen=True)
class TabledEstimate(Estimate, OfVersion):
    """An estimate of a version."""


def correlation_time(values: np.ndarray) -> float:
    """1 + 2 Σ ρ_k of a series (N,), by Geyer's initial positive sequence; N of one that is too short to tell."""
    count = len(values)
    if count < FEWEST:
        return float(count)
    centred = values - values.mean()
    level = centred @ centred
    if level <= 0:
        return 1.0
    rho = np.array([centred[k:] @ centred[: count - k] for k in range(count // 2)]) / level
    pairs = rho[: len(rho) // 2 * 2].reshape(-1, 2).sum(1)
    positive = int(np.argmax(pairs <= 0)) if (pairs <= 0).any() else len(pairs)
    return float(max(1.0, 2 * pairs[:positive].sum() - 1))


def blocks_of(values: np.ndarray) -> np.ndarray:
    """Numbers (N,) of blocks of successive values that are long enough to be independent."""
    count = len(values)
    blocks = int(np.clip(count / (2 * correlation_time(values)), 1, BLOCKS))
    return np.arange(count) * blocks // count


def of_trajectory(values: np.ndarray, errors: np.ndarray | None) -> Pooled:
    """The mean of one trajectory's windows (N,) in the order of their times.

    Of few blocks, whose scatter says little, the error is what the windows' own say, as if there were so many fewer of
    them as they are correlated.
    """
    blocks = blocks_of(values)
    if errors is None or not np.isfinite(errors).all():
        return pool(values, None, blocks)
    if blocks[-1] + 1 >= ENOUGH:
        return pool(values, errors, blocks)
    each = pool(values, errors)
    return Pooled(each.value, float(each.error * np.sqrt(correlation_time(values))), each.spread, 1)


def interval(pooled: Pooled, positive: bool = False) -> tuple[float, float]:
    """Ends of the interval of a mean: Student's t of its groups, or of a single one normal; of what cannot be negative
    it ends at zero."""
    quantile = 0.5 + LEVEL / 2
    wide = stats.t.ppf(quantile, pooled.groups - 1) if pooled.groups > 1 else stats.norm.ppf(quantile)
    low = pooled.value - wide * pooled.error
    return max(low, 0.0) if positive else low, pooled.value + wide * pooled.error


@dataclass(frozen=True)
class Stated:
    """What a version states of N windows.

    Attributes:
        values: (S, N, K), of S seeds.
        errors: standard deviations (S, N, K); None where it states none.
        names, units: of the K parameters.
        identity: of the windows, (N,); None: each is a trajectory.
        shared: number of independent groups of windows by name of the parameters that all share.
        constants: what the model's file says of windows together, beside these.
        positive: names of those that cannot be negative.
    """

    values: np.ndarray
    errors: np.ndarray | None
    names: Sequence[str]
    units: Sequence[str]
    identity: np.ndarray | None
    shared: Mapping[str, int]
    constants: Sequence[ConstantEstimate] = ()
    positive: Collection[str] = ()


def open_in(stated: Stated, ranges: Mapping[str, Sequence[float]]) -> dict[str, float]:
    """Share of the windows that leave a parameter open by themselves: the 90 % interval of one is wider than half the
    range of p⁺, or, of what cannot be negative, reaches zero."""
    shares = {}
    for k, name in enumerate(stated.names):
        if stated.errors is None:
            continue
        values, errors = (array[..., k].astype(float).mean(0) for array in (stated.values, stated.errors))
        finite = np.isfinite(values) & np.isfinite(errors)
        half = stats.norm.ppf(0.5 + LEVEL / 2) * errors[finite]
        ends = ranges.get(name)
        wide = np.zeros(len(half), bool) if ends is None else 2 * half >= TOLD * (ends[1] - ends[0])
        if name in stated.positive:
            wide |= half >= values[finite]
        shares[name] = float(wide.mean()) if len(wide) else 0.0
    return shares


def summarise(
    stated: Stated, ranges: Mapping[str, Sequence[float]], left_out: Sequence[str] = (), of: str = ALL
) -> list[Estimate]:
    """A version's estimates: shared ones once, others of all trajectories and, where they were measured, of each.

    Arguments:
        ranges: p⁺ by parameter, where it is known.
        left_out: parameters that are no constants, as initial speeds.
        of: how all trajectories together are called.
    """
    rows = []
    count, together = stated.values.shape[1], stated.constants
    left_open = {name for name, share in open_in(stated, ranges).items() if share > MOST_OPEN}

    def row(pooled: Pooled, name: str, unit: str, of: str, windows: int, of_windows: bool = False) -> Estimate:
        low, high = interval(pooled, name in stated.positive)
        ends = ranges.get(name)
        determined = None if ends is None or not np.isfinite(high - low) else high - low < TOLD * (ends[1] - ends[0])
        determined = determined if determined is None or not of_windows else determined and name not in left_open
        numbers = (pooled.value, pooled.error, low, high, pooled.spread, windows, pooled.groups)
        return Estimate(name, unit, of, *numbers, None if determined is None else bool(determined))

    for k, (name, unit) in enumerate(zip(stated.names, stated.units, strict=True)):
        if name in left_out:
            continue
        values = stated.values[..., k].astype(float)
        finite = np.isfinite(values).all(0)
        errors = None if stated.errors is None else stated.errors[..., k].astype(float)[:, finite]
        values, identity = values[:, finite], None if stated.identity is None else stated.identity[finite]
        own = [constant for constant in together if constant.name == name]
        rows += [row(_pool(constant), name, unit, constant.of, constant.windows or count) for constant in own]
        # Estimates that a distribution pulls scatter less than what they are of.
        if not finite.any() or any(constant.of_population for constant in own):
            continue
        windows, seeds = values.shape[1], values.mean(1)
        between = seeds.std(ddof=1) / np.sqrt(len(seeds)) if len(seeds) > 1 else 0.0
        if name in stated.shared:
            error = np.nan if errors is None else float(np.hypot(errors[:, 0].mean(), between))
            pooled = Pooled(float(seeds.mean()), error, np.nan, stated.shared[name])
            rows.append(row(pooled, name, unit, SHARED, windows))
            continue
        mean, typical = values.mean(0), None if errors is None else errors.mean(0)
        alone: dict[str, float] = {}  # errors of trajectories of one window, whose own it is whatever its weight
        if typical is not None and name in left_open:
            # Errors of weak estimates follow these: the low ones of a positive parameter would count most.
            typical = np.full_like(typical, np.sqrt(np.square(typical).mean()))
        each = {}
        for trajectory, places in places_by_trajectory(identity, windows).items():
            if errors is not None and len(places) == 1:
                alone[trajectory] = float(np.hypot(errors[:, places[0]].mean(), between))
            centre = of_trajectory(mean[places], None if typical is None else typical[places])
            each[trajectory] = (
                Pooled(centre.value, float(np.hypot(centre.error, between)), np.nan, centre.groups),
                len(places),
            )
        each |= {constant.of: (_pool(constant), constant.windows) for constant in own}
        if len(each) > 1:
            means, stds = (
                np.array([getattr(pooled, part) for pooled, _ in each.values()]) for part in ("value", "error")
            )
            pooled = pool(means, stds)
            error = float(np.hypot(pooled.error, between))
            of_all = Pooled(pooled.value, error, pooled.spread, pooled.groups)
            rows.append(row(of_all, name, unit, of, windows, of_windows=True))
        if identity is not None:
            done = {constant.of for constant in own}
            rows += [
                row(replace(pooled, error=alone.get(t, pooled.error)), name, unit, t, n, of_windows=True)
                for t, (pooled, n) in each.items()
                if t not in done
            ]
    of_sensors = [constant for constant in together if constant.name not in stated.names]
    return rows + [
        row(_pool(constant), constant.name, constant.unit, constant.of, constant.windows or count)
        for constant in of_sensors
    ]


def _pool(constant: ConstantEstimate) -> Pooled:
    return Pooled(constant.value, constant.error, constant.spread, constant.groups)


def run_stage(forecasts: Sequence[Path], outputs: Sequence[Path], job: EstimatesJob) -> None:
    """Stage: write the table of an experiment's estimates and draw them.

    Arguments:
        forecasts: forecasts.npz of all versions and groups of seeds.
        outputs: any of .csv, .md, .tex, .png and .pdf.

    Raises:
        InputError: a file is broken, or an output's suffix is unknown.
    """
    estimates(map(Forecasts.load, forecasts), job).save(outputs)


def estimates(forecasts: Iterable[Forecasts], job: EstimatesJob) -> Study:
    """The table and the figure of an experiment's estimates; where no version states a parameter they say so.

    Arguments:
        forecasts: of all versions and groups of seeds.

    Raises:
        InputError: they do not say whose they are.
    """
    of_version = group_by(forecasts, lambda of_group: of_group.identified().method)
    rows: list[TabledEstimate] = []
    seen: set[tuple[str, str, str]] = set()  # what all windows share is the same in every set
    experiment = ""
    for version, label in job.labels:
        parts = of_version.get(version, [])
        experiment = parts[0].identified().experiment if parts else experiment
        for of, stated in _list_stated(parts, job).items():
            for estimate in summarise(stated, job.priors.get(version, {}), job.starts, of):
                if (key := (version, estimate.parameter, estimate.of)) not in seen:
                    rows.append(TabledEstimate(method=version, label=label, **vars(estimate)))
                seen.add(key)
    title = f"{job.of_experiment(experiment)}: estimates"
    return Study(frame(TabledEstimate, rows), [table(rows, title)], lambda: draw(rows, job, title))


def _list_stated(parts: Sequence[Forecasts], job: EstimatesJob) -> dict[str, Stated]:
    """What a version's files state by what it is of: of measurements all sets, of simulations each set by itself."""
    parts = [part for part in parts if part.places]
    sets = {} if not parts else {n: forecast for n, forecast in parts[0].sets.items() if forecast.estimated is not None}
    if not sets:
        return {}
    first, names = parts[0], order_sets(sets)

    def joined(field: str, name: str) -> np.ndarray | None:
        each = [(getattr(part.sets[name], field), part.places) for part in parts]
        return (
            None if any(array is None for array, _ in each) else np.concatenate([array[good] for array, good in each])
        )

    def stated(chosen: Sequence[str], identity: np.ndarray | None) -> Stated:
        values, errors = ([joined(field, name) for name in chosen] for field in ("estimated", "estimated_std"))
        return Stated(
            np.concatenate(values, axis=1),  # type: ignore[arg-type]
            None if any(array is None for array in errors) else np.concatenate(errors, axis=1),  # type: ignore[arg-type]
            first.estimated_names,
            first.estimated_units,
            identity,
            first.shared,
            first.constants,
            first.positive_names,
        )

    if all(sets[name].sample_id is not None for name in names):
        return {ALL: stated(names, np.concatenate([sets[name].sample_id for name in names]))}
    if set(first.shared) >= set(first.estimated_names):  # the same in all sets
        return {SHARED: stated(names, None)}
    return {job.of_set(name): stated([name], None) for name in names if name != "train"}


def table(estimates: Sequence[TabledEstimate], title: str = "") -> Table:
    """Estimates as they are printed: to two digits of their errors."""
    head = ["method", "parameter", "of", "estimate", "±", "90 % interval", "spread", "windows", "told"]
    rows = []
    for estimate in estimates:
        shown = _round_to(estimate.error)
        quantity = f"{estimate.parameter} [{estimate.unit}]" if estimate.unit else estimate.parameter
        ends = f"[{shown(estimate.low)}, {shown(estimate.high)}]" if np.isfinite(estimate.low) else DASH
        verdict = DASH if estimate.told is None else "yes" if estimate.told else "no"
        numbers = [shown(estimate.value), shown(estimate.error), ends, shown(estimate.spread)]
        rows.append([estimate.label, quantity, estimate.of, *numbers, str(estimate.windows), verdict])
    return Table(head, [("", rows)], 3, (), title, CAPTION, "estimates", empty=EMPTY)


def draw(estimates: Sequence[TabledEstimate], job: EstimatesJob, title: str) -> Figure:
    """A panel for each parameter and a line for each estimate: 90 % interval, and paler the spread."""
    shown: dict[tuple[str, str], list[TabledEstimate]] = {}
    for estimate in estimates:
        if np.isfinite(estimate.value):
            shown.setdefault((estimate.parameter, estimate.unit), []).append(estimate)
    if not shown:
        return plotting.note(EMPTY)
    panels = {quantity: _few(rows, job) for quantity, rows in shown.items()}
    colours = plotting.colours([version for version, _ in job.labels], dict(job.hues))
    heights = [len(rows) + 2.5 for rows in panels.values()]
    figure = plotting.new_figure(LINE * sum(heights) + 0.9)
    every = figure.subplots(len(panels), 1, squeeze=False, height_ratios=heights)[:, 0]
    for axes, (quantity, rows) in zip(every, panels.items(), strict=True):
        for place, estimate in enumerate(rows):
            look = {"color": colours[estimate.method], "marker": plotting.marker(estimate.method), "markersize": 4}
            if np.isfinite(estimate.spread) and estimate.spread > 0:
                ends = estimate.value - estimate.spread, estimate.value + estimate.spread
                axes.plot(ends, (place, place), color=colours[estimate.method], alpha=0.25, linewidth=5)
            if np.isfinite(estimate.high - estimate.low):
                axes.plot((estimate.low, estimate.high), (place, place), color=colours[estimate.method], linewidth=1.3)
            axes.plot(estimate.value, place, linestyle="none", **look)
        axes.set_yticks(range(len(rows)), [_name(estimate, rows) for estimate in rows], fontsize=SMALL)
        axes.set(ylim=(len(rows) - 0.4, -0.6), xlabel=_quantity(*quantity), xlim=_limits(rows, axes))
        axes.xaxis.set_major_locator(MaxNLocator(TICKS))
        axes.grid(axis="x")
    plotting.heading(figure, plotting.text(title))
    handles = [Line2D([], [], color="0.3", marker="o", markersize=4, linewidth=1.3, label="90 % interval")]
    if any(estimate.spread > 0 for rows in panels.values() for estimate in rows):
        words = "spread between trajectories or windows"
        handles.append(Line2D([], [], color="0.3", alpha=0.25, linewidth=5, label=words))
    plotting.legend(figure, handles)
    return figure


def _name(estimate: TabledEstimate, beside: Sequence[TabledEstimate]) -> str:
    """What is printed for an estimate: the version, and of what it is where there are several or the label does not
    say it."""
    several = sum(other.method == estimate.method for other in beside) > 1
    file, _, number = estimate.of.rpartition("/")
    others = (other.of for other in beside if other.of != estimate.of)
    alone = number == "0" and not any(of.startswith(f"{file}/") for of in others)
    of = (file if alone else estimate.of).replace("_", " ")  # a file of a single trajectory
    label = plotting.text(estimate.label)
    return f"{label}, {of}" if several and estimate.of != SHARED else label


def _quantity(name: str, unit: str) -> str:
    """A parameter of an axis; constants of sensors are those of a state."""
    what, of, state = name.partition(" of ")
    return plotting.quantity(name, unit) if not of else f"{what} of {plotting.quantity(state, unit)}"


def _few(rows: list[TabledEstimate], job: EstimatesJob) -> list[TabledEstimate]:
    """A parameter's estimates; where there are too many without those of single trajectories, then of the versions that
    one figure compares, then of the sets that tables begin with."""
    if len(rows) > MOST:
        together = {estimate.method for estimate in rows if estimate.of == ALL}
        rows = [estimate for estimate in rows if estimate.method not in together or estimate.of == ALL]
    if len(rows) > MOST:
        chosen = choose_compared([version for version, _ in job.labels])
        rows = [estimate for estimate in rows if estimate.method in chosen] or rows
    if len(rows) > MOST:
        first = {job.of_set(name) for name in ("iid", "test")}
        rows = [estimate for estimate in rows if estimate.of in first] or rows
    return rows


def _limits(rows: Sequence[TabledEstimate], axes: Axes) -> tuple[float, float]:
    """Of an axis: all values, and the intervals and spreads of what data tell, so that one that says nothing does not
    hide the others; as drawn where none is."""
    certain = [estimate for estimate in rows if estimate.told is not False]
    ends = [estimate.value for estimate in rows]
    ends += [
        end
        for estimate in certain
        for end in (estimate.low, estimate.high, estimate.value - estimate.spread, estimate.value + estimate.spread)
    ]
    ends = [end for end in ends if np.isfinite(end)]
    low, high = min(ends), max(ends)
    margin = 0.06 * (high - low)
    return (low - margin, high + margin) if margin > 0 else axes.get_xlim()


def _round_to(error: float) -> Callable[[float], str]:
    """What prints numbers to two digits of their error, or to four of their own where that is not known."""

    def shown(value: float) -> str:
        if not np.isfinite(value):
            return DASH
        if not np.isfinite(error) or error <= 0:
            return f"{value:.4g}".replace("-", "−")
        digits = int(np.clip(1 - np.floor(np.log10(error)), 0, 12))
        return f"{value:.{digits}f}".replace("-", "−")

    return shown
