"""The stage tabulate-own-prior: the table of the ranges that p⁺ has found by itself."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from expertaug.errors import InputError
from expertaug.evaluation.settings import OwnPriorsJob
from expertaug.evaluation.table import Study, Table
from expertaug.rows import frame

CAPTION = (
    "Ranges of p⁺ that grew from those of the training windows' estimates, over the seeds of a group together. "
    "Explained: share of the windows that the model explains as well as its training windows (χ² after least squares "
    "below their 99 % quantile) with expert parameters in these ranges; below a half the expert with its F_a does not "
    "fit there. The first rows, before training, are the expert alone's."
)


@dataclass(frozen=True)
class OwnPrior:
    """The range of a parameter that the p⁺ of a version and group of seeds has found
    (:class:`expertaug.inference.adaptive_prior.AdaptivePrior`)."""

    label: str
    seeds: str
    parameter: str
    training_low: float
    training_high: float
    low: float
    high: float
    explained: float
    rounds: int
    windows: bool
    says: str


def run_stage(priors: Sequence[Path], outputs: Sequence[Path], job: OwnPriorsJob) -> None:
    """Stage: write the table.

    Arguments:
        priors: what the stage own-prior wrote.
        outputs: any of .csv, .md and .tex.

    Raises:
        InputError: a file is broken, or an output's suffix is unknown.
    """
    whose = zip(priors, job.priors, strict=True)
    rows = [row for path, (label, seeds) in whose for row in read_rows(path, label, seeds)]
    own_priors(rows, job).save(outputs)


def own_priors(rows: Sequence[OwnPrior], job: OwnPriorsJob) -> Study:
    """The table of the ranges of all versions and groups of seeds."""
    header = ["p⁺ of", "seeds", "parameter", "training windows", "found", "explained [%]"]
    cells = [
        [
            row.label,
            row.seeds,
            row.parameter,
            _range(row.training_low, row.training_high),
            _range(row.low, row.high),
            f"{100 * row.explained:.0f}",
        ]
        for row in rows
    ]
    title = f"{job.of_experiment(job.experiment)}: p⁺ that found its own ranges"
    return Study(frame(OwnPrior, rows), [Table(header, [("", cells)], 5, (), title, CAPTION, "own-priors")])


def read_rows(path: Path, label: str, seeds: str) -> list[OwnPrior]:
    """The rows of a version and group of seeds, one a parameter, from what the stage own-prior wrote.

    Raises:
        InputError: the file is broken.
    """
    try:
        made = json.loads(Path(path).read_text(encoding="utf-8"))
        explained, says = (made["explained"], made["rounds"], made["windows"]), made["says"]
        return [
            OwnPrior(label, seeds, name, *made["training"][name], low, high, *explained, says)
            for name, (low, high) in made["ranges"].items()
        ]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(path, f"holds no ranges of p⁺ ({error})", "make it again with own-prior") from error


def _range(low: float, high: float) -> str:
    return f"[{low:.3g}, {high:.3g}]".replace("-", "−")
