"""The stage plot: all figures of one experiment."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from expertaug.evaluation import dots, traces
from expertaug.evaluation.parameters import parameters
from expertaug.evaluation.products import PLOTTED
from expertaug.evaluation.settings import PlotJob

NAMES = [product.name for product in PLOTTED]


def plot(table: Path, forecasts: Sequence[Path], logs: Sequence[Path], prefix: Path, job: PlotJob) -> None:
    """Write ``<prefix>_<name>.png`` and ``.pdf`` for every name in :data:`NAMES`.

    Arguments:
        table: the experiment's long table (:mod:`expertaug.evaluation.tabulate`).
        forecasts: forecasts.npz of one group of seeds of each method, in the order of the job's labels.
        logs: log.jsonl of every trained method and group of seeds.

    Raises:
        InputError: a file is missing or broken.
    """
    by_method = dict(zip(job.label_of, forecasts, strict=True))
    traced = {method: by_method[method] for method in job.traced}

    def output(name: str) -> Path:
        return Path(f"{prefix}_{name}")

    dots.log_mse([table], output("log_mse"), job)
    dots.parameter_errors([table], output("parameter_errors"), job)
    parameters(traced, output("parameters"), job)
    traces.forecasts(traced, output("forecasts"), job, traces.View(measured=job.measured))
    traces.curves(logs, output("curves"), job, job.traced)
