"""The stage plot: all figures of one experiment."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from expertaug import plotting
from expertaug.evaluation import dots, traces
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.parameters import parameters
from expertaug.evaluation.products import PLOTTED
from expertaug.evaluation.settings import PlotJob
from expertaug.evaluation.summary import TabledMean, read_long
from expertaug.tracking.log import Log, read_log

NAMES = [product.name for product in PLOTTED]


def run_stage(table: Path, forecasts: Sequence[Path], logs: Sequence[Path], prefix: Path, job: PlotJob) -> None:
    """Stage: write ``<prefix>_<name>.png`` and ``.pdf`` for every name in :data:`NAMES`.

    Arguments:
        table: the experiment's long table (:mod:`expertaug.evaluation.tabulate`).
        forecasts: forecasts.npz of one group of seeds of each method, in the order of the job's labels.
        logs: log.jsonl of every trained method and group of seeds.

    Raises:
        InputError: a file is missing or broken.
    """
    by_method = dict(zip(job.label_of, forecasts, strict=True))
    traced = {method: Forecasts.load(by_method[method]) for method in job.traced}
    figures = plot(read_long(table), traced, map(read_log, logs), job)
    plotting.save_all({Path(f"{prefix}_{name}"): figure for name, figure in figures.items()})


def plot(
    rows: Sequence[TabledMean], forecasts: Mapping[str, Forecasts], logs: Iterable[Log], job: PlotJob
) -> dict[str, Figure]:
    """The figure of every name in :data:`NAMES`.

    Arguments:
        rows: of the experiment's long table.
        forecasts: of one group of seeds, by method: of those that the job traces.
        logs: of every trained method and group of seeds.

    Raises:
        InputError: a metric, a set or a seed that is drawn is not there.
    """
    return {
        "log_mse": dots.log_mse(rows, job),
        "parameter_errors": dots.parameter_errors(rows, job),
        "parameters": parameters(forecasts, job),
        "forecasts": traces.forecasts(forecasts, job, traces.View(measured=job.measured)),
        "curves": traces.curves(logs, job, job.traced),
    }
