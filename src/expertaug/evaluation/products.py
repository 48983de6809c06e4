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


@dataclass(frozen=True, kw_only=True)
class OverviewKind(Product):
    """A figure over several experiments.

    Attributes:
        shows: the entry of an experiment's block of :class:`~expertaug.evaluation.settings.OverviewJob` that says
            whether it has a panel.
        draw: a function of :mod:`expertaug.evaluation.dots`, which is imported when the figure is made.
    """

    figure: bool = True
    of_all: bool = True
    shows: str
    draw: str


PLOTTED = tuple(
    Product(name, figure=True) for name in ("log_mse", "parameter_errors", "parameters", "forecasts", "curves")
)
OVERVIEWS = (
    OverviewKind("log_mse", shows="shown", draw="log_mse_of_all"),
    OverviewKind("parameter_errors", shows="shown", draw="parameter_errors_of_all"),
    OverviewKind("za_shifted", shows="shifted", draw="log_mse_of_shifted"),
)
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
