"""Subcommands about the tracking store and finished runs."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable
from pathlib import Path

logger = logging.getLogger(__name__)


def add_to(add: Callable[..., argparse.ArgumentParser]) -> None:
    """Add this module's subcommands."""
    text = "rebuild the MLflow store from the logs"
    p = add("rebuild-tracking", _rebuild_tracking, text, "inspect", "expertaug rebuild-tracking results")
    p.add_argument("results", type=Path, help="results folder")
    p.add_argument("--uri", help="of the store (default: sqlite in RESULTS/mlflow)")
    p.add_argument(
        "--experiment", default="expertaug", help="what names of MLflow experiments begin with (default: %(default)s)"
    )

    examples = """
    expertaug publish config/config.yaml --to published/mine --command "snakemake --cores 2"
    """
    p = add("publish", _publish, "copy a finished run's tables, figures and provenance to a folder", "use", examples)
    p.add_argument("config", type=Path, nargs="+", help="YAML files of the run, later ones win")
    p.add_argument("--to", type=Path, required=True, metavar="FOLDER", help="folder; what it holds is replaced")
    p.add_argument("--command", required=True, help="the command that started the run, for its provenance")


def _rebuild_tracking(a: argparse.Namespace) -> None:
    from expertaug.tracking.rebuild import rebuild

    uri = a.uri or f"sqlite:///{a.results}/mlflow/mlflow.db"
    count = rebuild(a.results, uri, a.experiment)
    logger.info("%s: %d logs stored", uri, count)


def _publish(a: argparse.Namespace) -> None:
    from expertaug.config import load as config
    from expertaug.errors import InputError
    from expertaug.runs.publish import publish
    from expertaug.stages.files import Files
    from expertaug.stages.planned import list_kept, products_of, products_of_all

    configuration = config.validate(config.load(config.with_defaults(a.config)))
    files = Files(configuration)
    expected = [*products_of_all(files), *(path for name in configuration.run for path in products_of(files, name))]
    missing = [path for path in expected if not Path(path).exists()]
    if missing:
        others = f" (and {len(missing) - 1} others)" if len(missing) > 1 else ""
        raise InputError(missing[0], f"no such file{others}", "run the workflow to its end first")
    publish(configuration, a.to, a.command, list_kept)
    logger.info("%s: published", a.to)
