"""The stage plot: all figures of one experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from expertaug.evaluation import dots, traces
from expertaug.evaluation.parameters import parameters
from expertaug.evaluation.products import PLOTTED

NAMES = [product.name for product in PLOTTED]


def plot(
    metrics: Sequence[Path], forecasts: Sequence[Path], logs: Sequence[Path], prefix: Path, settings: Mapping
) -> None:
    """Write ``<prefix>_<name>.png`` and ``.pdf`` for every name in :data:`NAMES`.

    Arguments:
        metrics: metrics.csv of every method and group of seeds.
        forecasts: forecasts.npz of one group of seeds of each method, in the order of ``settings["labels"]``.
        logs: log.jsonl of every trained method and group of seeds.
        settings: {labels, all_methods, traced, floor, measured, convention, set_titles, title, training_range,
            priors}: pairs of this experiment's methods and their labels, in order; all methods of the configuration,
            which fix the colours; the versions that figures of lines and of points show; that of the true equation, or
            null; whether the states were measured; ranges of the expert parameters where they are known, else empty;
            priors by method.

    Raises:
        InputError: a file is missing or broken.
    """
    labels = dict(settings["labels"])
    by_method = dict(zip(labels, forecasts, strict=True))
    ranges = {key: settings[key] for key in ("training_range", "priors") if settings[key]}
    shared = {k: settings[k] for k in ("labels", "all_methods", "set_titles", "title")}
    floor, traced = {"floor": settings["floor"]}, {m: by_method[m] for m in settings["traced"]}
    rest = {"left_out": len(by_method) - len(traced), "measured": settings["measured"]}

    def output(name: str) -> Path:
        return Path(f"{prefix}_{name}")

    dots.log_mse(metrics, output("log_mse"), shared | floor | {"convention": settings["convention"]})
    dots.parameter_errors(metrics, output("parameter_errors"), shared)
    parameters(traced, output("parameters"), shared | ranges)
    traces.forecasts(traced, output("forecasts"), shared | rest)
    traces.curves(logs, output("curves"), shared | {"traced": list(traced)})
