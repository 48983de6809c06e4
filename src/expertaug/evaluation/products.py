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


def _figures(*names: str, of_all: bool = False) -> tuple[Product, ...]:
    return tuple(Product(name, figure=True, of_all=of_all) for name in names)


PLOTTED = _figures("log_mse", "parameter_errors", "parameters", "forecasts", "curves")
OVERVIEWS = _figures("log_mse", "parameter_errors", "za_shifted", of_all=True)
# Further questions to the scores: KINDS of :mod:`expertaug.evaluation.studies`.
STUDIES = tuple(
    Product(name, table=True, figure=True)
    for name in ("out_of_expertise", "horizons", "prior_width", "during_training")
)
