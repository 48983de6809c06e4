"""The log of an evaluation: what it is called, and which figures belong to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from expertaug.tracking.run import Run
from expertaug.tracking.runlog import RunLog

NAME = "evaluation.jsonl"
FIGURES = ("forecasts.png", "parameters.png")  # drawn when all of an experiment is evaluated


def write_log(metrics: Path, identity: Mapping, seeds: Sequence[int], settings: Mapping) -> None:
    """Write the log beside a metrics.csv; its figures are named in it before they are there.

    Arguments:
        identity: {experiment, method, label, preset, system}.
        settings: as of :func:`expertaug.evaluation.evaluate.evaluate`.
    """
    params = {"evaluation": settings["evaluation"], "choices": settings["choices"]}
    run = Run(**identity, stage="evaluate", seeds=seeds, params=params, tags={"rule": "evaluate"})
    with RunLog(metrics.with_name(NAME), run) as log:
        log.table(metrics)
        for path in (metrics, *map(metrics.with_name, FIGURES)):
            log.artifact(path)
