"""The stage own-priors: the table of the ranges that p⁺ has found by itself."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation.settings import OwnPriorsJob
from expertaug.evaluation.table import Study, Table

CAPTION = (
    "Ranges of p⁺ that grew from those of the training windows' estimates, over the seeds of a group together. "
    "Explained: share of the windows that the model explains as well as its training windows (χ² after least squares "
    "below their 99 % quantile) with expert parameters in these ranges; below a half the expert with its F_a does not "
    "fit there. The first rows, before training, are the expert alone's."
)


def own_priors(priors: Sequence[Path], outputs: Sequence[Path], job: OwnPriorsJob) -> None:
    """Write the table.

    Arguments:
        priors: what the stage own-prior wrote.
        outputs: any of .csv, .md and .tex.

    Raises:
        InputError: a file is broken, or an output's suffix is unknown.
    """
    rows = []
    for path, (label, group) in zip(priors, job.priors, strict=True):
        try:
            ranges = json.loads(Path(path).read_text(encoding="utf-8"))
            for name, (low, high) in ranges["ranges"].items():
                first, last = ranges["training"][name]
                one = {"parameter": name, "training_low": first, "training_high": last, "low": low, "high": high}
                told = {key: ranges[key] for key in ("explained", "rounds", "windows")}
                rows.append({"label": label, "seeds": group, **one, **told, "says": ranges["says"]})
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(path, f"holds no ranges of p⁺ ({error})", "make it again with own-prior") from error
    header = ["p⁺ of", "seeds", "parameter", "training windows", "found", "explained [%]"]
    cells = [
        [
            *(str(row[key]) for key in ("label", "seeds", "parameter")),
            f"[{row['training_low']:.3g}, {row['training_high']:.3g}]".replace("-", "−"),
            f"[{row['low']:.3g}, {row['high']:.3g}]".replace("-", "−"),
            f"{100 * row['explained']:.0f}",
        ]
        for row in rows
    ]
    title = f"{job.of_experiment(job.experiment)}: p⁺ that found its own ranges"
    Study(pd.DataFrame(rows), [Table(header, [("", cells)], 5, (), title, CAPTION, "own-priors")]).save(outputs)
