"""What the stages of evaluation make: every table and figure of a run, declared once.

The workflow's targets, what ``publish`` keeps, and the figures that ``plot`` draws are these.
"""

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
        stage: that makes it.
        table, figure: whether there is one.
        of_all: whether it is of all experiments of a run: its name stands alone.
    """

    name: str
    stage: str
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


def _each(stage: str, *names: str, **kinds: bool) -> list[Product]:
    return [Product(name, stage, **kinds) for name in names]


PLOTTED = _each("plot", "log_mse", "parameter_errors", "parameters", "forecasts", "curves", figure=True)
STUDIES = _each("study", "out_of_expertise", "horizons", "prior_width", "during_training", table=True, figure=True)
WINDOW_STUDIES = [Product(name, name, table=True, figure=True) for name in ("alarm", "coverage", "distance")]
PRODUCTS = [
    Product("", "tabulate", table=True),
    *PLOTTED,
    Product("splits", "plot_splits", figure=True),
    *STUDIES,
    *WINDOW_STUDIES,
    *(Product(name, name, table=True, figure=True) for name in ("grid", "validity", "dissipation", "estimates")),
    Product("data_curves", "data_curves", table=True, figure=True),
    Product("equation", "equation", table=True),
    Product("own_priors", "tabulate_own_prior", table=True),
    Product("published", "compare", table=True),
    Product("published", "compare", table=True, of_all=True),
    *_each("overview", "log_mse", "parameter_errors", "za_shifted", figure=True, of_all=True),
]


def kept(experiments: list[str]) -> list[str]:
    """The tables and pictures of a run, in the results folder: figures as PNG alone."""
    of_each = [file for e in experiments for one in PRODUCTS if not one.of_all for file in one.files(e, ("png",))]
    long = [f"tables/{experiment}_long.csv" for experiment in experiments]
    return [*long, *of_each, *(file for one in PRODUCTS if one.of_all for file in one.files("", ("png",)))]
