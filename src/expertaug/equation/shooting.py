"""Formulas refitted through the solver: coefficients, the expert's constants and every window's start together.

A formula is the expert with terms; each coefficient is one of all windows or each window's own, as the expert's
parameters are.  All are found by the same least squares of whole trajectories (multiple windows, one shot each)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from expertaug.inference.coordinates import LatentCoordinates
from expertaug.inference.joint_fit import (
    NormalEquations,
    clustered_variances,
    minimise_each,
    minimise_together,
    normal_equations,
)
from expertaug.inference.pooling import Pooled, pool
from expertaug.inference.shared import groups_of
from expertaug.inference.window_problem import WindowProblem
from expertaug.learning.divergence import clamp_to_bound, forecast_or_fallback
from expertaug.learning.residuals import squared_errors
from expertaug.models.decoder import Decoder
from expertaug.models.fit_settings import RefinementSettings
from expertaug.models.interactions.equation import EquationInteraction
from expertaug.models.observation_noise import NoiseLike
from expertaug.models.posterior import Estimates
from expertaug.models.terms import Term
from expertaug.systems import System
from expertaug.systems.inputs import inputs_of, states_of
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows

TOLERANCE = 1e-6  # of the cost, where a refit ends
STEPS = 15  # of a fit that starts at one of a formula with a term more or less
FREE = 1e9  # standard deviations of a coefficient that nothing pulls


@dataclass(frozen=True)
class Formula:
    """Terms beside the expert.

    Attributes:
        terms: none: the expert alone.
        shared: of each coefficient, whether all windows have one.
    """

    terms: tuple[Term, ...] = ()
    shared: tuple[bool, ...] = ()

    def plus(self, term: Term, shared: bool) -> Formula:
        """With a further term."""
        return Formula((*self.terms, term), (*self.shared, shared))

    def without(self, place: int) -> Formula:
        """Without the term at a place."""
        terms, shared = list(self.terms), list(self.shared)
        del terms[place], shared[place]
        return Formula(tuple(terms), tuple(shared))

    def sharing(self, place: int) -> Formula:
        """With one coefficient at a place for all windows."""
        return Formula(self.terms, tuple(s or k == place for k, s in enumerate(self.shared)))

    def freedom(self, windows: int) -> int:
        """Number of its coefficients over so many windows."""
        return sum(1 if s else windows for s in self.shared)

    @property
    def length(self) -> int:
        """Of its terms' texts."""
        return sum(term.length for term in self.terms)

    def __str__(self) -> str:
        each = zip(self.terms, self.shared, strict=True)
        return ", ".join(f"{t}" if s else f"{t} (of each window)" for t, s in each) or "no term"


@dataclass(frozen=True)
class Sample:
    """Windows that formulas are fitted to.

    Attributes:
        windows: y and known inputs at all times, (T, 1, N, *observed), float64.
        groups: numbers (N,) of the groups of windows that count as independent.
        observed: points that are seen before a forecast.
    """

    windows: Tensor
    groups: np.ndarray
    observed: int

    @classmethod
    def of(cls, data: Trajectories, observed: int) -> Sample:
        return cls(Windows.of(data).joined.double(), groups_of(data), observed)

    @property
    def count(self) -> int:
        return self.windows.shape[2]


@dataclass(frozen=True)
class Guess:
    """Where the fits of N windows start.

    Attributes:
        z_e: (1, N, P).
        y0: (1, N, *state).
        coefficients: of terms, (N,) each.
    """

    z_e: Tensor
    y0: Tensor
    coefficients: Mapping[Term, Tensor] = field(default_factory=dict)


@dataclass(frozen=True)
class Fit:
    """A formula at its minimum.

    Attributes:
        formula: what was fitted.
        guess: the parameters there.
        equations: the problem's linear approximation there.
        places: of the coordinates that windows share.
        numbers: how many were compared.
        least: sum of squares a number below which nothing is gained.
    """

    formula: Formula
    guess: Guess
    equations: NormalEquations
    places: tuple[int, ...]
    numbers: int
    least: float

    @cached_property
    def cost(self) -> float:
        """Sum of squared residuals in units of the noise."""
        return float(self.equations.cost.sum())

    @cached_property
    def criterion(self) -> float:
        """Bayesian information criterion."""
        return criterion(self.cost, self.numbers, self.formula.freedom(len(self.equations.cost)), self.least)


def criterion(cost: float, numbers: int, freedom: int, least: float) -> float:
    """Bayesian information criterion of a sum of squares; below ``least`` a number nothing is gained."""
    return numbers * math.log(max(cost / numbers, least)) + freedom * math.log(numbers)


class Shooting:
    """What formulas are fitted with.

    Arguments:
        system: gives the expert.
        t: times of the windows in s, (T,).
        noise: standard deviation of the observation, > 0, one or one a component.
        assumed: whether the data have none: to explain less than it is no gain.
        free_start: whether first points are noisy.
        solver: of the fits.
        scales: typical size of each term's coefficient.
        units: names of the expert parameters that all windows share.
        bound: (K,), how far forecasts may go.
        ranges: of first points' components, where windows may have values that were not measured.
        own: whether a coefficient may be each window's own.
    """

    def __init__(
        self,
        system: System,
        t: Tensor,
        noise: NoiseLike,
        assumed: bool,
        free_start: bool,
        solver: Solver,
        scales: Mapping[Term, float],
        units: Sequence[str],
        bound: Tensor | None,
        ranges: Mapping[str, Sequence[float]] | None,
        own: bool,
    ) -> None:
        self.system, self.t, self.noise, self.free_start, self.solver = system, t.double(), noise, free_start, solver
        self.least, self.own = 1.0 if assumed else 1e-12, own
        self.scales, self.bound, self.ranges = dict(scales), bound, ranges
        names = [p.name for p in system.expert_parameters]
        self.shared = [names.index(name) for name in units]

    def problem(
        self, formula: Formula, points: int, prior: Mapping[Term, tuple[float, float]] | None = None
    ) -> WindowProblem:
        """The windows' problem of a formula: its coefficients are all in the place of z_a.

        Arguments:
            points: that are compared.
            prior: mean and standard deviation of coefficients; None: nothing pulls them.
        """
        terms = formula.terms
        functions = {str(term): term.function for term in terms if term.function is not None}
        interaction = EquationInteraction(self.system, len(terms), functions, terms=[str(term) for term in terms])
        moments = [(0.0, self.scales[t]) if prior is None else prior[t] for t in terms]
        mean, std = (torch.tensor([[[m[k] for m in moments]]], dtype=torch.float64) for k in (0, 1))
        settings = RefinementSettings.from_mapping({"starts": 0} | ({"latent_width": FREE} if prior is None else {}))
        latent = LatentCoordinates(mean, std.clamp_min(1e-9))
        decoder = Decoder(self.system, interaction)
        arguments = (settings, self.noise, self.free_start, None, latent, self.solver, self.ranges)
        return WindowProblem(decoder, self.t[:points], *arguments)

    def places(self, formula: Formula) -> tuple[int, ...]:
        """Of the coordinates that all windows share."""
        own = len(self.system.expert_parameters)
        return (*self.shared, *(own + k for k, s in enumerate(formula.shared) if s))

    def start(self, problem: WindowProblem, formula: Formula, guess: Guess, sample: Sample) -> Tensor:
        """Coordinates (1, N, K) of a guess; terms that it does not know are absent at first."""
        zero = torch.zeros(sample.count, dtype=torch.float64)
        coefficients = [guess.coefficients.get(term, zero) for term in formula.terms]
        z_a = torch.stack(coefficients, -1) if coefficients else zero.new_zeros(len(zero), 0)
        x = problem.coordinates(Estimates(guess.y0, guess.z_e, z_a.unsqueeze(0)), problem.first(sample.windows))
        places = list(self.places(formula))
        x[..., places] = x[..., places].median(dim=1, keepdim=True).values
        return x

    def fit(self, formula: Formula, guess: Guess, sample: Sample) -> Fit:
        """A formula's coefficients, expert parameters and starts by all points of the windows."""
        problem, windows = self.problem(formula, len(self.t)), sample.windows
        x, places = self.start(problem, formula, guess, sample), self.places(formula)
        if places:
            x, equations, _ = minimise_together(problem, windows, x, places, TOLERANCE, STEPS)
        else:
            x = minimise_each(problem, windows, x, steps=STEPS)
            equations = normal_equations(problem, windows, x)
        numbers = problem.observations * sample.count - int(problem.missing(windows).sum())
        return Fit(formula, self._guess(problem, formula, x, windows), equations, places, numbers, self.least)

    def linearise(self, fit: Fit, terms: Sequence[Term], sample: Sample) -> NormalEquations:
        """The equations at a fit with further terms, whose coefficients are zero there: coordinates of the expert, of
        the formula's terms, of the further ones, of the start."""
        formula = fit.formula
        for term in terms:
            formula = formula.plus(term, True)
        problem = self.problem(formula, len(self.t))
        zero = torch.zeros(sample.count, dtype=torch.float64)
        coefficients = [fit.guess.coefficients.get(term, zero) for term in formula.terms]
        first = Estimates(fit.guess.y0, fit.guess.z_e, torch.stack(coefficients, -1).unsqueeze(0))
        return normal_equations(problem, sample.windows, problem.coordinates(first, problem.first(sample.windows)))

    def errors(self, fit: Fit, guess: Guess, sample: Sample) -> np.ndarray:
        """Squared error (N,) of forecasts after the observed window, what windows do not share being estimated on it.

        Arguments:
            fit: gives what they share, and, for a window's own coefficients, their mean and spread.
            guess: of the windows' own parameters.
        """
        formula = fit.formula
        coefficients = self.values(fit, np.arange(len(fit.equations.cost)))
        prior = {
            term: (coefficient.value, 0.0 if math.isnan(coefficient.spread) else coefficient.spread)
            for term, coefficient in zip(formula.terms, coefficients, strict=True)
        }
        problem = self.problem(formula, sample.observed, prior)
        seen = sample.windows[: sample.observed]
        means = {term: torch.full((sample.count,), mean, dtype=torch.float64) for term, (mean, _) in prior.items()}
        z_e = guess.z_e.clone()
        z_e[..., self.shared] = fit.guess.z_e[:, :1, self.shared]
        x = self.start(problem, formula, Guess(z_e, guess.y0, means), sample)
        x = minimise_each(problem, seen, x, self.places(formula), STEPS)
        z_e, z_a, y0 = problem.parts(x, problem.first(seen))
        u = inputs_of(self.system, sample.windows)
        states = forecast_or_fallback(problem.decoder, y0, z_e, z_a, self.t, self.solver, u)
        states = clamp_to_bound(states, self.bound)
        truth = states_of(self.system, sample.windows)
        return squared_errors(self.system, states[sample.observed :], truth[sample.observed :])[0].numpy()

    def values(self, fit: Fit, groups: np.ndarray) -> list[Pooled]:
        """Each coefficient of a formula: one that all windows share has a spread of NaN, of windows' own ones mean and
        spread are given, each weighed by what its window says of it."""
        own, formula = len(self.system.expert_parameters), fit.formula
        variances = clustered_variances(fit.equations, fit.places, groups) if fit.places else None
        places = [k for k in range(fit.equations.slope.shape[1]) if k not in fit.places]
        inverse = torch.linalg.pinv(fit.equations.curvature[:, places][:, :, places])
        variance = inverse.diagonal(dim1=1, dim2=2).clamp_min(0) * max(fit.cost / fit.numbers, 1e-30)
        coefficients = []
        for k, (term, shared) in enumerate(zip(formula.terms, formula.shared, strict=True)):
            each = fit.guess.coefficients[term]
            if shared:
                assert variances is not None
                place = fit.places.index(own + k)
                std = float(variances[place].sqrt()) * self.scales[term]
                coefficients.append(Pooled(float(each[0]), std, math.nan, len(set(groups.tolist()))))
            else:
                std = variance[:, places.index(own + k)].sqrt() * self.scales[term]
                coefficients.append(pool(each.numpy(), std.numpy(), groups))
        return coefficients

    def constants(self, fit: Fit, groups: np.ndarray) -> dict[str, tuple[float, float]]:
        """Value and standard error of the expert parameters that all windows share, by name."""
        if not self.shared:
            return {}
        variances = clustered_variances(fit.equations, fit.places, groups)
        constants = {}
        for place, k in enumerate(self.shared):
            parameter, value = self.system.expert_parameters[k], float(fit.guess.z_e[0, 0, k])
            slope = value if parameter.positive else parameter.scale
            constants[parameter.name] = (value, abs(slope) * float(variances[place].sqrt()))
        return constants

    def _guess(self, problem: WindowProblem, formula: Formula, x: Tensor, windows: Tensor) -> Guess:
        z_e, z_a, y0 = problem.parts(x, problem.first(windows))
        return Guess(z_e, y0, {term: z_a[0, :, k] for k, term in enumerate(formula.terms)})
