"""The stage tabulate: the tables of an experiment's metrics, and what augmented versions gain over their controls; the
report makes the same tables of what this stage wrote."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from operator import attrgetter
from pathlib import Path

import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation.forecasts import Forecasts, read_forecasts
from expertaug.evaluation.intervals import LEVEL, Interval
from expertaug.evaluation.metrics import COST, DIVERGED, RELATIVE_ERROR, Shown, metric_of
from expertaug.evaluation.samples import Samples
from expertaug.evaluation.settings import TabulateJob
from expertaug.evaluation.summary import (
    IDENTITY,
    Mean,
    TabledMean,
    any_of,
    cell_of,
    last_columns,
    order_sets,
    read_metrics,
    shown_metrics,
    tabled_metrics,
    with_intervals,
)
from expertaug.evaluation.table import DASH, Cell, Row, Study, Table, spans
from expertaug.rows import cells, frame, group_by
from expertaug.tracking.metrics_csv import MetricRow
from expertaug.versions import CONTROL, SHOWN_SETS, Version, order_versions

Column = tuple[str, str]  # set and metric
Place = tuple[str, str, str]  # row, set and metric
KNOWN_FORM = "F_a of known form, which does not compete"  # a title over rows
BEHIND = 1.0  # nats
VALIDATION = "validation"
WORST = (
    "Log-MSE of the worst seed; in brackets, how many seeds are worse by more than 1 than the best of the same "
    "version, or have no finite value."
)
BEST = "Bold: the best of each column, and those without a significant difference from it."
# Only the first is a gain of augmentation: an augmented version was also trained for longer than its base.
OVER_CONTROL, FROM_BASE = "gain over control", "difference from base"
CHOICE = (
    "Choice by validation: the simplest version whose log-MSE there is within one standard error of the best one's "
    "(of the difference, paired by seed and sample). Versions without a network are simpler than those with one, then "
    "values that all windows share than those of each, then versions without an encoder; otherwise the order of the "
    "methods decides. The choice cannot account for a shift that the validation windows do not have."
)
CHOSEN = "chosen"
KINDS = (OVER_CONTROL, FROM_BASE)
GAINS = (
    "Gain over control: how much lower the error is than that of the control, the same base model trained further for "
    "as many steps on the real data alone. Difference from base: how much lower it is than that of the base model, "
    "which had fewer steps: no gain of augmentation. Positive is better. Means over pairs of the same seed and "
    "sample with their 95 % intervals; bold: significant."
)


def run_stage(
    metrics: Sequence[Path],
    outputs: Sequence[Path],
    job: TabulateJob | None = None,
    forecasts: Sequence[Path] = (),
) -> None:
    """Stage: write the tables of one experiment or of several (one table each).

    Arguments:
        metrics: metrics.csv of every method and group of seeds.
        outputs: any of ``….csv`` (wide), ``…_long.csv``, ``….md`` and ``….tex`` (booktabs).  CSV files hold all metrics
            in full precision, the long one of all sets; LaTeX the log-MSE, the parameters' error and the share of
            runaways where there are any, Markdown these and the others in a table of its own, of the shown sets.
        forecasts: forecasts.npz of the same runs.

    Raises:
        InputError: a file is broken, there are none of these metrics, or an output's suffix is unknown.
    """
    tabulate(read_metrics(metrics), job, read_forecasts(forecasts)).save(outputs)


def tabulate(rows: Sequence[MetricRow], job: TabulateJob | None = None, forecasts: Sequence[Forecasts] = ()) -> Study:
    """Tables of means over seeds with their intervals; rows are methods, columns set × metric.  A second table has what
    augmented versions gain over their controls.

    Arguments:
        rows: the metrics of every method and seed.
        forecasts: of the same runs: errors of every sample, from which the intervals come (without them standard
            deviations over seeds are printed), and the parameters' units.

    Raises:
        InputError: forecasts of one version have other samples, or there are none of these metrics.
    """
    job = job or TabulateJob(labels=[])
    units, samples = _units(forecasts), Samples(forecasts)
    long = _with_choice(_with_gains(_prepare(rows, job, samples), samples), job, samples)
    if not shown_metrics(long, job.convention):
        available = ", ".join(_metrics(long))
        raise InputError("metrics", "neither log-MSE nor parameter error is in the files", f"they hold {available}")
    main = [mean for mean in long if mean.set in SHOWN_SETS]
    parts = group_by(main, lambda mean: mean.experiment)
    tables = [table for part in parts.values() for table in _tables(part, job, samples, units)]
    return Study(_wide(main), tables, long=frame(TabledMean, long))


def _tables(part: Sequence[TabledMean], job: TabulateJob, samples: Samples, units: Mapping[str, str]) -> list[Table]:
    """The log-MSE and the parameters' error, what augmentation gains, and the other metrics, of one experiment."""
    name, columns = part[0].experiment, columns_of(part, job)
    best = _best(part, columns, samples, (*job.floors, *job.known_form))
    label, title, caption = name.replace("_", "-"), job.of_experiment(name), f"{_caption(part, job, samples)} {BEST}"
    tables = [main_table(part, job, best, title, caption, label)]
    gained = gains_table(part, job, lambda gain: gain.told_apart, True, f"{title}, gains", f"{label}-gains")
    other_metrics = [m.name for m in map(metric_of, _metrics(part)) if m.shown in (Shown.WHERE_ANY, Shown.LAST)]
    more = further_table(part, job, (*tabled_metrics(part, job.convention), *other_metrics), units)
    others = (choice_table(part, job), gained, seeds_table(part, job), more)
    return [*tables, *(table for table in others if table and table.size)]


def main_table(
    part: Sequence[TabledMean],
    job: TabulateJob,
    best: Collection[Place] = (),
    title: str = "",
    caption: str = "",
    label: str = "",
) -> Table:
    """An experiment's methods by sets and metrics, those that know the form of F_a in a part of their own.

    Arguments:
        part: of the sets that are shown.
        best: places of cells that are marked.
    """
    columns, values = columns_of(part, job), by_place(part)
    competing: list[Row] = []
    others: list[Row] = []
    for row, first in _firsts(part).items():
        shown = [_cell(values, (row, *column), (row, *column) in best) for column in columns]
        rows = others if first.method in job.known_form else competing
        rows.append([first.label, str(len(first.seeds)), *shown])
    parts = [("", competing), *([(KNOWN_FORM, others)] if others else [])]
    head = ["method", "seeds", *(metric_of(metric).heading() for _, metric in columns)]
    over = [("", 1), *spans(job.of_set(name) for name, _ in columns)]
    return Table(head, parts, 1, over, title, caption, label)


def columns_of(part: Sequence[TabledMean], job: TabulateJob) -> list[Column]:
    """The columns (set, metric) of the first table that hold a value, set by set; shares of diverged forecasts where
    there are any, and last what an estimate costs."""
    diverging = {mean.set for mean in part if mean.metric == DIVERGED.name and mean.mean > 0}
    filled = {(mean.set, mean.metric) for mean in part if mean.metric != DIVERGED.name or mean.set in diverging}
    metrics = tabled_metrics(part, job.convention)
    columns = [(name, metric) for name in _sets(part) for metric in metrics if (name, metric) in filled]
    return [*columns, *last_columns(part)]


def gains_table(
    part: Sequence[TabledMean],
    job: TabulateJob,
    told_apart: Callable[[Interval], bool],
    all_kinds: bool,
    label_title: str = "",
    label: str = "",
) -> Table | None:
    """What augmented versions gain over their controls, and their difference from the base model; None where there is
    neither.

    Arguments:
        told_apart: whether a difference is one from 0.
        all_kinds: whether versions with one of the two have a row for the other too.
    """
    values = by_place(part)

    def cell(place: Place, kind: str) -> Cell | None:
        return gain_cell(values.get(place), kind, told_apart)

    firsts = _firsts(part)
    columns = [c for c in columns_of(part, job) if any(cell((row, *c), kind) for row in firsts for kind in KINDS)]
    compared, rows = {mean.row for mean in part if mean.gain or mean.difference}, []
    for row, first in firsts.items():
        for kind in KINDS:
            shown = [cell((row, *column), kind) for column in columns]
            if (all_kinds and row in compared) or any(shown):
                rows.append([first.label, kind, *(cell or DASH for cell in shown)])
    head = ["method", "", *(metric_of(metric).heading() for _, metric in columns)]
    over = spans(job.of_set(name) for name, _ in columns)
    return Table(head, [("", rows)], 2, over, "", GAINS, label, label_title) if rows else None


def seeds_table(part: Sequence[TabledMean], job: TabulateJob) -> Table | None:
    """The worst seed of each version; None where no version has several, or no log-MSE."""
    metric, values = tabled_metrics(part, job.convention)[0], by_place(part)
    if not metric_of(metric).is_log:
        return None
    rows: list[Row] = []
    for row, first in _firsts(part).items():
        own = [values.get((row, name, metric)) for name in _sets(part)]
        if any(mean is not None and len(mean.values or ()) > 1 and mean.std != 0 for mean in own):
            rows.append([first.label, str(len(first.seeds)), *map(_worst, own)])
    head = ["method", "seeds", *(job.of_set(name) for name in _sets(part))]
    return Table(head, [("", rows)], 1, caption=WORST) if rows else None


def choice_table(part: Sequence[TabledMean], job: TabulateJob) -> Table | None:
    """The versions that may be chosen, the best first, with the chosen one marked; None where there is no choice."""
    metric, values = tabled_metrics(part, job.convention)[0], by_place(part)
    able = sorted((mean for mean in part if mean.behind is not None), key=attrgetter("mean"))
    if len(able) < 2:
        return None
    chosen = choose_simplest(able, job)
    sets = [name for name in _sets(part) if name not in ("train", VALIDATION)]
    rows: list[Row] = []
    for mean in able:
        numbers = [_nats(mean.behind), _nats(mean.behind_error)]
        further = [_cell(values, (mean.row, name, metric)) for name in sets]
        rows.append([mean.label, mean.cell(), *numbers, CHOSEN if mean is chosen else "", *further])
    head = ["method", job.of_set(VALIDATION), "behind", "standard error", "", *map(job.of_set, sets)]
    return Table(head, [("", rows)], 1, caption=CHOICE)


def _nats(value: float | None) -> str:
    return DASH if value is None or not math.isfinite(value) else f"{value:.2f}".replace("-", "−")


def choose_simplest(able: Iterable[TabledMean], job: TabulateJob) -> TabledMean:
    """The simplest of those that are as good as the best."""
    return min((mean for mean in able if mean.as_good), key=lambda mean: job.candidates.index(mean.method))


def _with_choice(long: Sequence[TabledMean], job: TabulateJob, samples: Samples) -> list[TabledMean]:
    """The same with how far each version that may be chosen is behind the best on the validation set."""
    if not (metrics := tabled_metrics(long, job.convention)) or not metric_of(metrics[0]).is_log:
        return list(long)
    metric, behind = metrics[0], {}
    able = [
        mean for mean in long
        if (mean.set, mean.metric) == (VALIDATION, metric) and mean.method in job.candidates and mean.n == mean.of > 0
    ]  # fmt: skip
    for part in group_by(able, lambda mean: (mean.experiment, mean.preset)).values():
        best = min(part, key=attrgetter("mean"))
        differences = {id(mean): samples.behind(mean.version, best.version, VALIDATION, metric) for mean in part}
        behind |= {key: difference for key, difference in differences.items() if difference is not None}
    return [
        replace(mean, behind=behind[id(mean)][0], behind_error=behind[id(mean)][1]) if id(mean) in behind else mean
        for mean in long
    ]


def _worst(mean: TabledMean | None) -> str:
    finite = [] if mean is None else [value for value in mean.values or () if math.isfinite(value)]
    if mean is None or not mean.values:
        return DASH
    worst = f"{max(finite):.2f}".replace("-", "−") if len(finite) == len(mean.values) else "not finite"
    return f"{worst} ({mean.seeds_behind(BEHIND)})"


def gain_cell(mean: TabledMean | None, kind: str, told_apart: Callable[[Interval], bool]) -> Cell | None:
    """A difference with its interval, marked where it is told apart from 0; None where there is none."""
    gain = None if mean is None else mean.gain if kind == OVER_CONTROL else mean.difference
    if mean is None or gain is None:
        return None
    return Cell(metric_of(mean.metric), gain.mean, math.nan, 1, 1, gain.low, gain.high, told_apart(gain))


def further_table(
    part: Sequence[TabledMean], job: TabulateJob, left_out: Collection[str], units: Mapping[str, str] | None = None
) -> Table:
    """All other metrics, a row for each and each method, a column for each set."""
    sets, values, rows = _sets(part), by_place(part), []
    for metric in map(metric_of, _metrics(part)):
        title = metric.heading(units) + (f" ({metric.name})" if metric.is_log else "")
        for row, first in _firsts(part).items() if metric.name not in left_out else ():
            places = [(row, name, metric.name) for name in sets]
            if any(place in values for place in places):
                rows.append([title, first.label, *(_cell(values, place) for place in places)])
    head = ["metric", "method", *(job.of_set(name) for name in sets)]
    return Table(head, [("", rows)], 2, caption="Further metrics:")


def by_place(part: Iterable[TabledMean]) -> dict[Place, TabledMean]:
    """Means by row (method and preset), set and metric."""
    return {(mean.row, mean.set, mean.metric): mean for mean in part}


def _firsts(part: Iterable[TabledMean]) -> dict[str, TabledMean]:
    """The first mean of each row, which says whose it is."""
    return {row: own[0] for row, own in group_by(part, lambda mean: mean.row).items()}


def _sets(part: Iterable[Mean]) -> list[str]:
    return order_sets(mean.set for mean in part)


def _metrics(part: Iterable[Mean]) -> list[str]:
    return list(dict.fromkeys(mean.metric for mean in part))


def _cell(values: Mapping[Place, TabledMean], place: Place, marked: bool = False) -> Cell:
    return cell_of(values, place, place[2], marked)


def _caption(part: Sequence[TabledMean], job: TabulateJob, samples: Samples) -> str:
    """What every table says of itself: preset, seeds, spread, convention, units."""
    parts = [f"Preset: {', '.join(dict.fromkeys(mean.preset for mean in part))}.", _spread(part, samples)]
    chosen = tabled_metrics(part, job.convention)
    if metric_of(chosen[0]).is_log:
        times = "the forecast window (t1, t2]" if job.from_s is None else f"times from {job.from_s} s on"
        times = times if "from_s" in job.model_fields_set else "the evaluated times"
        parts.append(
            f"log-MSE (no unit): natural logarithm of the mean, over samples and {times}, of the squared error"
            f" {job.convention_text} (convention: {job.convention})."
        )
    if RELATIVE_ERROR.name in chosen:
        parts.append("Error: mean of |estimate − truth| / |truth| of the expert parameters, in %.")
        if any(mean.of == 0 for mean in part):
            parts.append(f"{DASH} there: nobody knows the truth.")
    if any(mean.n < mean.of for mean in part):
        parts.append("(a/b): only a of b seeds have a finite value, and only those are averaged.")
    if any_of(DIVERGED, part):
        parts.append(DIVERGED.note)
    if COST.name in _metrics(part):
        parts.append(COST.note)
    return " ".join(parts)


def _spread(part: Sequence[TabledMean], samples: Samples) -> str:
    """What stands beside a mean."""
    sizes = sorted({len(mean.seeds) for mean in part})
    counted = "1 seed" if sizes == [1] else f"{' or '.join(map(str, sizes))} seeds"
    deviation = f"standard deviation (n − 1) over {counted} per method; {DASH}: no value, or none of one seed."
    if all(math.isnan(mean.low) for mean in part):
        return f"Mean ± {deviation}"
    resampled = "whole recordings" if samples.by_recording(part[0].experiment) else "samples"
    both = f"{resampled} alone" if sizes == [1] else f"seeds and {resampled} both"
    ends = f"Mean and the ends of its 95 % interval, for which {both} are resampled."
    return f"{ends} Where samples' errors are not kept, mean ± {deviation}"


def _best(
    part: Sequence[TabledMean], columns: Sequence[Column], samples: Samples, apart: Collection[str]
) -> set[Place]:
    """Of every column of errors with something to compare: the method with the best mean over all of its seeds, and
    those that a test on pairs of the same seed and samples does not tell apart from it."""
    marked: set[Place] = set()
    # The equation that made the data is a floor, no competitor; a method that is told its form is none either.
    competing = [mean for mean in part if mean.method not in apart and mean.n == mean.of > 0]
    for name, metric in columns:
        column = [mean for mean in competing if (mean.set, mean.metric) == (name, metric)]
        better = metric_of(metric).better
        if len(column) < 2 or better is None:
            continue
        best = (min if better == "lower" else max)(column, key=lambda mean: mean.mean)
        marked.add((best.row, name, metric))
        for other in column:
            difference = samples.difference(best.version, other.version, name, metric)
            if difference is not None and difference.p >= 1 - LEVEL:
                marked.add((other.row, name, metric))
    return marked


def references(version: str, versions: Iterable[str]) -> dict[str, str]:
    """The versions with which an augmented one is compared, of those that were run, by :data:`KINDS`."""
    augmented, names = Version.parse(version), set(versions)
    base = replace(augmented, step="", prior=None)
    wanted = {OVER_CONTROL: str(replace(base, step=CONTROL)), FROM_BASE: str(base)}
    return {kind: name for kind, name in wanted.items() if name in names}


def _with_gains(long: Sequence[TabledMean], samples: Samples) -> list[TabledMean]:
    """The same with what augmented versions gain; positive is better."""
    runs = group_by(long, lambda mean: (mean.experiment, mean.preset))
    methods = {run: {mean.method for mean in part} for run, part in runs.items()}

    def compared(mean: TabledMean) -> TabledMean:
        if not Version.parse(mean.method).is_augmented:
            return mean
        differences = {
            kind: samples.difference(mean.version, mean.version._replace(method=reference), mean.set, mean.metric)
            for kind, reference in references(mean.method, methods[mean.experiment, mean.preset]).items()
        }
        return replace(mean, gain=differences.get(OVER_CONTROL), difference=differences.get(FROM_BASE))

    return [compared(mean) for mean in long]


def _units(forecasts: Sequence[Forecasts]) -> dict[str, str]:
    """Unit of each parameter by name."""
    return {
        name: unit for run in forecasts for name, unit in zip(run.parameter_names, run.parameter_units, strict=True)
    }


def _prepare(rows: Sequence[MetricRow], job: TabulateJob, samples: Samples) -> list[TabledMean]:
    """The summary, sorted as printed, with seeds and ends of intervals; where one experiment has several presets,
    labels name theirs."""
    runs = group_by(rows, lambda row: row.experiment)
    several = {experiment for experiment, part in runs.items() if len({row.preset for row in part}) > 1}
    named = [replace(row, label=f"{row.label} ({row.preset})") if row.experiment in several else row for row in rows]
    long = with_intervals(named, samples)
    long += _unknown_errors(long, samples)
    methods, metrics = order_versions([mean.method for mean in long], job.label_of), _metrics(long)
    experiments, presets = (list(dict.fromkeys(map(attrgetter(name), long))) for name in ("experiment", "preset"))
    ranks = (experiments, methods, presets, _sets(long), metrics)

    def place(mean: TabledMean) -> list[int]:
        values = (mean.experiment, mean.method, mean.preset, mean.set, mean.metric)
        return [of.index(value) for of, value in zip(ranks, values, strict=True)]

    return sorted(long, key=place)


def _unknown_errors(long: Sequence[TabledMean], samples: Samples) -> list[TabledMean]:
    """A mean of no seeds, printed as –, for each error of parameters that nobody can know."""
    nothing = dict.fromkeys(("mean", "std", "low", "high"), math.nan)
    return [
        replace(part[0], metric=RELATIVE_ERROR.name, n=0, of=0, values=None, **nothing)
        for key, part in group_by(long, lambda mean: (mean.version, mean.set)).items()
        if RELATIVE_ERROR.name not in _metrics(part) and samples.estimates_unknown(*key)
    ]


def _wide(means: Sequence[TabledMean]) -> pd.DataFrame:
    """One row per method; columns <set>/<metric>/mean, /std, /n, /low, /high and those of gains."""
    table, rows = cells(TabledMean, means), {}
    values = [name for name in table if name not in (*IDENTITY, "of", "seeds", "values", "behind", "behind_error")]
    for place, mean in enumerate(means):
        whose = {key: table[key][place] for key in ("experiment", "preset", "method", "label", "seeds")}
        row = rows.setdefault((mean.experiment, mean.row), whose)
        row |= {f"{mean.set}/{mean.metric}/{name}": table[name][place] for name in values}
    wide = pd.DataFrame(list(rows.values()))
    return wide.astype({name: "Int64" for name in wide if name.endswith("/n")})
