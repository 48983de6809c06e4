"""From a learned term to an equation: what is missing in the expert, as terms that can be read."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from expertaug import systems
from expertaug.api import arguments
from expertaug.api.arguments import Noise
from expertaug.api.trained import TrainedModel
from expertaug.equation.result import Found
from expertaug.equation.search import Options, Search
from expertaug.measurements.slopes import slope
from expertaug.models.terms import Term
from expertaug.systems import System
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories

SLOPE = (
    "%s is %.3g (± %.1g) of the slope of %s: a scale, or other units, of its sensor, which no term of its own rate "
    "mends; let kinematics=True, or sensors={'%s': {'scale': 'shared'}} in the fits, say which"
)
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Equation(Found):
    """What the expert lacks, in terms: as :class:`expertaug.equation.result.Found`, with tables and a model."""

    def __repr__(self) -> str:
        """What it says."""
        return f"Equation({'; '.join(self.says.splitlines())})"

    @cached_property
    def model(self) -> TrainedModel:
        """Expert and equation as a trained model, whose windows are fitted by least squares."""
        return TrainedModel(self.stored, single=True, refinement=self.stored.card.refinement)

    @property
    def table(self) -> pd.DataFrame:
        """Rows ``expert alone``, ``network`` (where there is one), ``equation`` and ``by hand`` (where given); columns
        ``terms``, ``log-MSE`` of validation forecasts (summed over the dimensions; the lower the better) and
        ``coefficients``, how many numbers the terms have."""
        rows = {
            row.name: {"terms": row.terms, "log-MSE": row.log_mse, "coefficients": row.coefficients}
            for row in self.rows
        }
        return pd.DataFrame.from_dict(rows, orient="index")

    @property
    def path(self) -> pd.DataFrame:
        """Every formula that was refitted, the best first: ``formula``, ``source`` (direct, network or by hand),
        ``mean squared error`` of validation forecasts."""
        rows = [(str(candidate.formula), candidate.source, candidate.score) for candidate in self.tried]
        return pd.DataFrame(rows, columns=["formula", "source", "mean squared error"])


def explain(
    model: TrainedModel,
    train: Trajectories,
    validation: Trajectories,
    *,
    extra: Sequence[Term | str] = (),
    only: Sequence[Term | str] | None = None,
    by_hand: Sequence[Term | str] = (),
    components: Sequence[str] | None = None,
    kinematics: bool = False,
    by_parameters: bool = False,
    units: Mapping[str, str] | None = None,
    noise: Noise | None = None,
    most_terms: int = 8,
    max_samples: int = 500,
    solver: Solver | None = None,
    label: str = "Equation",
) -> Equation:
    """Find the terms that the expert lacks, and fit their coefficients with the expert's constants through the solver.

    Terms are proposed by the windows themselves (the normal equations of the expert's fits, every window's own unknowns
    eliminated) and, of a model with an F_a, by F_a's values at the states that its windows visit.  Every formula is
    refitted to the whole training windows by least squares; terms are taken away again by the error of validation
    forecasts, and of formulas as good within one standard error the shortest is chosen: no term at all may be.
    Validation windows should lie outside the training's in the direction in which the model is to be used.

    Arguments:
        model: of :func:`expertaug.least_squares`, without a network, or with an F_a; it gives the expert, the observed
            window and where fits start.
        train, validation: sets of the same times, with points after the observed window.
        extra: further candidates: ``ea.Term("omega", "abs(omega)**1.5")``, the same as ``"omega: abs(omega)**1.5"``,
            or ``ea.Term("omega", "my drag", function)``.
        only: candidates instead of the library (:func:`expertaug.equation.library.library`).
        by_hand: the terms that a scientist would write, refitted in the same way: the opponent.
        components: of the state, in whose rates terms are sought; None: those on which F_a acts, or all rates that are
            no other component by the expert's definition.
        kinematics: whether such rates count too, as θ' of a pendulum.
        by_parameters: whether the library has components divided by expert parameters, as forces by an inertia.
        units: ``shared`` or ``window`` by expert parameter: whether all windows have one; None: as the model has it.
            Where all windows share all of them, a coefficient is one number; else it may be each window's own.
        noise: standard deviation of the data's noise; None: as the model's fits have it.
        most_terms: of a formula.
        max_samples: windows of each set, evenly spread.
        solver: of the fits; None: as the model's.
        label: of :attr:`Equation.model`.

    Returns:
        coefficients with standard errors and their drift, scores on validation, and a model.

    Raises:
        InputError: an argument that cannot be used, a model without an expert, or windows without points to forecast.
    """
    train, validation = (
        arguments.trajectories(data, name).spread(max_samples)
        for data, name in ((train, "train"), (validation, "validation"))
    )
    arguments.check_sets(model.system, train, validation)
    options = Options(
        extra=_terms(extra),
        only=None if only is None else _terms(only),
        by_hand=_terms(by_hand),
        components=None if components is None else tuple(components),
        kinematics=kinematics,
        by_parameters=by_parameters,
        most=most_terms,
    )
    if not kinematics and (model.refinement is None or not model.refinement.settings.sensors):
        _warn_of_slopes(model.system, train)
    given_noise = None if noise is None else arguments.noise(noise)
    with arguments.one_thread():
        search = Search(
            model.stored, model.predictor, model.refinement, train, validation, units, given_noise, solver, label
        )
        return Equation(**vars(search.run(options)))


def _warn_of_slopes(system: System, data: Trajectories) -> None:
    """Tell of a column that is not the slope of the one whose rate it is: no term of its own rate mends that."""
    names, seen = [p.name for p in system.state], data.seen
    for rate, of in systems.rates(system).items():
        k, j = names.index(of), names.index(rate)
        estimate = slope([(data.t, window[:, k], window[:, j]) for window in np.asarray(seen)])
        if estimate is not None and estimate.is_off:
            logger.warning(SLOPE, rate, estimate.factor, estimate.error, of, rate)


def _terms(terms: Sequence[Term | str]) -> tuple[Term, ...]:
    return tuple(Term.of(term) for term in terms)
