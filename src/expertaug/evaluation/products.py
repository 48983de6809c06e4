"""What a stage makes for readers: its tables and figures, which each stage names (:mod:`expertaug.stages`)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

TABLE_ENDS, FIGURE_ENDS = ("csv", "md", "tex"), ("png", "pdf")
EVALUATION_LOG = "evaluation.jsonl"  # beside an evaluation's metrics
OWN_FIGURES = ("forecasts.png", "parameters.png")  # of an evaluation, drawn when all of an experiment is evaluated


@dataclass(frozen=True)
class Product:
    """A table, a figure, or both, of one experiment or of all of a run.

    Attributes:
        name: behind the experiment's in the files' names; empty for its own table.
        table, figure: whether there is one.
        of_all: whether it is of all experiments of a run: its name stands alone.
    """

    name: str
    table: bool = False
    figure: bool = False
    of_all: bool = False

    def files(self, experiment: str, figure_ends: tuple[str, ...] = FIGURE_ENDS) -> Iterator[str]:
        """Its files in the results folder, tables first."""
        stem = self.name if self.of_all else f"{experiment}_{self.name}" if self.name else experiment
        if self.table:
            yield from (f"tables/{stem}.{end}" for end in TABLE_ENDS)
        if self.figure:
            yield from (f"figures/{stem}.{end}" for end in figure_ends)


@dataclass(frozen=True, kw_only=True)
class StudyKind(Product):
    """A further question to the scores of an experiment, with a table and a figure.

    Attributes:
        title: of the table.
        along: whether it is along a training, and its metrics have columns that say where.
        rows, draw: functions of :mod:`expertaug.evaluation.studies`, which is imported when a study is made: the rows
            of its table, and its figure.
    """

    table: bool = True
    figure: bool = True
    title: str
    along: bool = False
    rows: str
    draw: str


def _figures(*names: str, of_all: bool = False) -> tuple[Product, ...]:
    return tuple(Product(name, figure=True, of_all=of_all) for name in names)


PLOTTED = _figures("log_mse", "parameter_errors", "parameters", "forecasts", "curves")
OVERVIEWS = _figures("log_mse", "parameter_errors", "za_shifted", of_all=True)
STUDIES = (
    StudyKind("out_of_expertise", title="shifts out of the expertise", rows="shift_rows", draw="shifts"),
    StudyKind("horizons", title="longer forecasts", rows="horizon_rows", draw="horizons"),
    StudyKind("prior_width", title="width of the augmentation prior", rows="width_rows", draw="widths"),
    StudyKind(
        "during_training",
        title="augmentation along the training",
        along=True,
        rows="during_training_rows",
        draw="during_training",
    ),
)
