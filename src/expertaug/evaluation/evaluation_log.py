"""The log of an evaluation: what it is called, and which figures belong to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from expertaug.tracking.log_file import read_log
from expertaug.tracking.run import Run
from expertaug.tracking.runlog import RunLog

NAME = "evaluation.jsonl"
FIGURES = ("forecasts.png", "parameters.png")  # drawn when all of an experiment is evaluated


def write_log(metrics: Path, model: Path, identity: Mapping, seeds: Sequence[int], settings: Mapping) -> None:
    """Write the log beside a metrics.csv; its figures are named in it before they are there.

    Its parameters are those of the training, where that has left its log beside the model, and its own: scores and
    hyperparameters stand on one run.

    Arguments:
        model: the model file that was evaluated.
        identity: {experiment, method, label, preset, system}.
        settings: as of :func:`expertaug.evaluation.evaluate.evaluate`.
    """
    training = model.with_name("log.jsonl")
    params = dict(read_log(training).header["params"]) if training.is_file() else {}
    params["choices"] = {**params.get("choices", {}), **settings["choices"]}
    params["evaluation"] = settings["evaluation"]
    tags = {"rule": "evaluate", "table": f"tables/{identity['experiment']}.md"}
    run = Run(**identity, stage="evaluate", seeds=seeds, params=params, tags=tags)
    with RunLog(metrics.with_name(NAME), run) as log:
        log.table(metrics)
        for path in (metrics, *map(metrics.with_name, FIGURES)):
            log.artifact(path)
