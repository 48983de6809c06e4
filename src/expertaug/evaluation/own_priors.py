"""The stage own-priors: the table of the ranges that p⁺ has found by itself."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation.formats import booktabs, escape, grid, write_tables
from expertaug.evaluation.summary import experiment_title

CAPTION = (
    "Ranges of p⁺ that grew from those of the training windows' estimates, over the seeds of a group together. "
    "Explained: share of the windows that the model explains as well as its training windows (χ² after least squares "
    "below their 99 % quantile) with expert parameters in these ranges; below a half the expert with its F_a does not "
    "fit there. The first rows, before training, are the expert alone's."
)


def own_priors(priors: Sequence[Path], outputs: Sequence[Path], settings: Mapping) -> None:
    """Write the table.

    Arguments:
        priors: what the stage own-prior wrote.
        outputs: any of .csv, .md and .tex.
        settings: {experiment, priors, title}; ``priors`` has, in the files' order, what is printed for each version and
            its group of seeds.

    Raises:
        InputError: a file is broken, or an output's suffix is unknown.
    """
    rows = []
    for path, (label, group) in zip(priors, settings["priors"], strict=True):
        try:
            found = json.loads(Path(path).read_text(encoding="utf-8"))
            for name, (low, high) in found["ranges"].items():
                first, last = found["training"][name]
                one = {"parameter": name, "training_low": first, "training_high": last, "low": low, "high": high}
                told = {"explained": found["explained"], "rounds": found["rounds"], "windows": found["windows"]}
                rows.append({"label": label, "seeds": group, **one, **told, "says": found["says"]})
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
    title = f"{experiment_title(settings['experiment'], settings)}: p⁺ that found its own ranges"
    lines = [f"## {title}", "", CAPTION, "", *grid(header, [[escape(c) for c in r] for r in cells], 5)]
    write_tables(
        outputs,
        {
            ".csv": lambda _: pd.DataFrame(rows).to_csv(index=False),
            ".md": lambda _: "\n".join(lines) + "\n",
            ".tex": lambda _: booktabs(header, cells, 5, CAPTION, "own-priors", title),
        },
    )
