"""Does F_a stay valid when z_e moves?  The paper's assumption A1, checked on a trained model.

Augmentation simulates with an F_a that was learned where the training windows lie.  Three answers are given: how well
the model explains each window after least squares (χ², without any truth); for simulated data, how far F_a is from the
true interaction on the window's own states; and whether F_a changes when it is fitted on to other windows.  An F_a
that is valid where z_e has moved has nothing to learn there: from where the training left it, it stays what it was.
What the same fit changes on the training's own windows is the yardstick.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.inference.least_squares import WindowFit, estimator_of
from expertaug.inference.levenberg_marquardt import DAMPING, adapt_damping, cost_of, of_columns, trial
from expertaug.inference.settings import ValiditySettings
from expertaug.learning.optimiser import clip_each_seed
from expertaug.models.decoder import Decoder
from expertaug.models.fit_settings import RefinementSettings
from expertaug.models.observation_noise import GivenNoise
from expertaug.models.store import StoredModel
from expertaug.systems.inputs import further, inputs_of, states_of
from expertaug.windows import Windows

BINS = 8
TAIL = 0.01  # share of training windows, at each end, beyond whose estimates by half of the range others are outliers
TAKEN = 0.75  # of the windows of a bin must be explained for F_a to hold there
QUANTILE = 0.95  # of the training windows' χ²: what is above is not explained
CLIP, THRESHOLD = 5.0, 5.0  # as in a training by alternation
LAST = 3  # steps of the estimates with the new F_a


@dataclass(frozen=True)
class Validity:
    """Where along one expert parameter F_a holds.

    Attributes:
        parameter: its name.
        edges: of the bins, (B + 1,), in its unit.
        explained: share of each bin's windows whose χ² is below ``limit``, (B,); NaN in an empty bin.
        chi2: median χ² per degree of freedom of each bin, (B,).
        limit: the 95 % quantile of the training windows' χ².
        trained: lowest and highest value of the training windows.
    """

    parameter: str
    edges: np.ndarray
    explained: np.ndarray
    chi2: np.ndarray
    limit: float
    trained: tuple[float, float]

    @property
    def holds(self) -> tuple[float, float] | None:
        """The range around the training range in which every bin is explained; None where not even that one is."""
        low, high = self.trained
        centres = 0.5 * (self.edges[1:] + self.edges[:-1])
        good = np.isnan(self.explained) | (self.explained >= TAKEN)
        inside = np.flatnonzero((centres >= low) & (centres <= high))
        if not len(inside) or not good[inside].all():
            return None
        first, last = inside[0], inside[-1]
        while first > 0 and good[first - 1]:
            first -= 1
        while last < len(good) - 1 and good[last + 1]:
            last += 1
        return float(self.edges[first]), float(self.edges[last + 1])

    @property
    def says(self) -> str:
        """One sentence."""
        where = f"F_a learned on {self.parameter} in [{self.trained[0]:.3g}, {self.trained[1]:.3g}]"
        interval = self.holds
        if interval is None:
            return f"{where} does not explain its own range"
        return f"{where} holds in [{interval[0]:.3g}, {interval[1]:.3g}] of the windows given"


def along(parameter: str, z_e: np.ndarray, chi2: np.ndarray, train_z_e: np.ndarray, train_chi2: np.ndarray) -> Validity:
    """Where along a parameter windows are explained as well as the training windows are.

    Arguments:
        z_e, chi2: of windows, (N,); χ² per degree of freedom after least squares.
        train_z_e, train_chi2: of training windows, (M,).

    Raises:
        InputError: shapes disagree, or a value is no number.
    """
    for name, parameters, other in (("chi2", z_e, chi2), ("train_chi2", train_z_e, train_chi2)):
        if parameters.shape != other.shape or parameters.ndim != 1 or not len(parameters):
            raise InputError(
                name, f"has shape {other.shape}", f"give a number for each of {parameters.shape} parameters"
            )
        if np.isnan(parameters).any() or np.isnan(other).any():
            raise InputError(name, "has values that are no numbers", "leave these windows out")
    limit = float(np.quantile(train_chi2, QUANTILE))
    own = _without_outliers(train_z_e)
    ends = min(z_e.min(), own.min()), max(z_e.max(), own.max())
    edges = np.linspace(*ends, BINS + 1)
    place = np.clip(np.searchsorted(edges, z_e, side="right") - 1, 0, BINS - 1)
    bins = [chi2[place == k] for k in range(BINS)]
    explained = np.array([np.mean(values <= limit) if len(values) else np.nan for values in bins])
    median = np.array([np.median(values) if len(values) else np.nan for values in bins])
    return Validity(parameter, edges, explained, median, limit, (float(own.min()), float(own.max())))


def _without_outliers(values: np.ndarray) -> np.ndarray:
    """Estimates but those of windows that say nothing of the parameter: a pendulum that hangs still fits any ω0."""
    low, high = np.quantile(values, (TAIL, 1 - TAIL))
    slack = 0.5 * (high - low)
    return values[(values >= low - slack) & (values <= high + slack)]


@torch.no_grad()
def error_of_interaction(
    decoder: Decoder,
    t: Sequence[float],
    y: Tensor,
    z_e: Tensor,
    z_a: Tensor,
    found_z_e: Tensor,
    found_z_a: Tensor,
    u: Tensor | None = None,
) -> Tensor:
    """‖F_a − truth‖ / ‖truth‖ along each window's own states: (S, N); simulated data alone know the truth.

    Arguments:
        decoder: stacked over S seeds, with F_a.
        t: times in s, (T,).
        y: states (T, N, *state).
        z_e, z_a: true parameters (N, P) and (N, Q).
        found_z_e, found_z_a: estimates (S, N, ·), of which F_a is a function.
        u: known inputs (T, N, U) of a system that has some.

    Raises:
        InputError: a decoder without F_a.
    """
    if decoder.interaction is None:
        raise InputError("model", "has no interaction model", "give a hybrid one")
    system, seeds = decoder.system, found_z_a.shape[0]
    context = decoder.context(found_z_a, found_z_e)
    wrong = torch.zeros(seeds, y.shape[1], dtype=torch.float64)
    size = torch.zeros(y.shape[1], dtype=torch.float64)
    inputs = [None] * len(y) if u is None else u
    for time, state, u_t in zip(t, y, inputs, strict=True):
        at, more = torch.as_tensor(time, dtype=y.dtype), further(system, state, z_e, u_t)
        true = system.truth(at, state, z_e, z_a, *more) - system.expert(at, state, z_e, *more)
        wide = None if u_t is None else u_t.expand(seeds, *u_t.shape)
        learned = decoder.interaction_rate(state.expand(seeds, *state.shape), context, at, wide)
        wrong += (learned - true).double().square().flatten(2).sum(-1)
        size += true.double().square().flatten(1).sum(-1)
    return (wrong / size).sqrt()


@dataclass(frozen=True)
class Refit:
    """What a fit of F_a to N windows changed.

    Attributes:
        z_e: of the windows by least squares with F_a as it was, (S, N, P).
        chi2: per degree of freedom, of each window with F_a as it was, (S, N).
        chi2_after: after the fit of F_a.
        squares: sum over the window's times of F_a² along its own trajectory, (S, N).
        changes: the same of the change of F_a.
        wrong: ‖F_a − truth‖ / ‖truth‖ on the window's own states, (S, N), before and after, where the truth is known.
    """

    z_e: Tensor
    chi2: Tensor
    chi2_after: Tensor
    squares: Tensor
    changes: Tensor
    wrong: tuple[Tensor, Tensor] | None = None

    def change(self, windows: Tensor | None = None) -> Tensor:
        """‖ΔF_a‖ / ‖F_a‖ (S,) over all windows, or those of a mask (N,)."""
        chosen = slice(None) if windows is None else windows
        return (self.changes[:, chosen].sum(1) / self.squares[:, chosen].sum(1).clamp_min(1e-300)).sqrt()


def refit(
    stored: StoredModel,
    windows: Windows,
    noise: GivenNoise,
    prior: Mapping[str, tuple[float, float]] | None,
    settings: Mapping | RefinementSettings | None = None,
    how: ValiditySettings | None = None,
    truth: tuple[Tensor, Tensor] | None = None,
) -> Refit:
    """Fit F_a on to windows by gradient steps, from what it is, with the windows' estimates improved in turns.

    Arguments:
        stored: trained, with an interaction model; it stays as it is.
        windows: observed, y (T1, 1, N, *state).
        noise, prior, settings: of the least squares (:func:`estimator_of`).
        how: number and size of the steps.
        truth: z_e (N, P) and z_a (N, Q) of simulated windows.

    Raises:
        InputError: a model without an interaction model.
    """
    if getattr(stored.model, "interaction", None) is None:
        raise InputError("model", "has no interaction model", "give a hybrid one, or one of kind alternating")
    how, seeds = how or ValiditySettings(), len(stored.seeds)
    estimator = estimator_of(stored, settings, noise, prior)
    windows = windows.expand(seeds)
    estimates = estimator.estimate(windows)
    assert estimates.z_e is not None and estimates.z_a is not None and estimates.chi2 is not None
    fit, y = estimator.fit, windows.joined.cpu().double()
    x = fit.coordinates(estimates.to(y), fit.first(y))
    new, x_new = _fit(fit, x, y, how)
    squares, changes = _difference(fit, new, x, x_new, y)
    chi2_after = _chi2(new, x_new, y)
    wrong = None
    if truth is not None:
        z_e, z_a = (value.double() for value in truth)
        t = fit.t.tolist()
        parts = [(window_fit.parts(at, fit.first(y))) for window_fit, at in ((fit, x), (new, x_new))]
        states, u = states_of(fit.system, y[:, 0]), inputs_of(fit.system, y[:, 0])
        each = [
            error_of_interaction(window_fit.decoder, t, states, z_e, z_a, part[0], part[1], u)
            for window_fit, part in zip((fit, new), parts, strict=True)
        ]
        wrong = each[0], each[1]
    return Refit(estimates.z_e.cpu().double(), _chi2(fit, x, y), chi2_after, squares, changes, wrong)


def _fit(fit: WindowFit, x: Tensor, y: Tensor, how: ValiditySettings) -> tuple[WindowFit, Tensor]:
    """The fit with an F_a that has taken gradient steps on windows y (T1, S, N, *observed), and the estimates by it."""
    new = copy.copy(fit)
    new.decoder = copy.deepcopy(fit.decoder).requires_grad_(True)
    assert new.decoder.interaction is not None
    parameters = list(new.decoder.interaction.parameters())
    optimiser = torch.optim.Adam(parameters, lr=how.learning_rate)
    damping = torch.full(x.shape[:2], DAMPING, dtype=torch.float64)
    x, limit = x.clone(), THRESHOLD**2

    def residuals(candidates: Tensor, columns: Tensor) -> Tensor:
        return new.residuals(candidates, of_columns(y, columns))

    for _ in range(how.steps):
        moved, cost = trial(residuals, x, damping, new.longest)
        data = new.differences(new.states(moved, y), y)
        better = cost_of(torch.cat((data.detach(), new.pull(moved)), -1)) < cost
        x, damping = torch.where(better[..., None], moved, x), adapt_damping(damping, better)
        each = (limit * torch.log1p(data.nan_to_num(0.0, 0.0, 0.0).square() / limit)).mean(-1)
        loss = torch.where(better, each, torch.zeros_like(each)).sum(-1) / better.sum(-1).clamp_min(1)
        if not loss.requires_grad:
            break
        optimiser.zero_grad(set_to_none=True)
        loss.sum().backward()
        clip_each_seed(parameters, CLIP, torch.ones(x.shape[0], dtype=torch.bool))
        optimiser.step()
    new.decoder.requires_grad_(False)
    for _ in range(LAST):
        moved, cost = trial(residuals, x, damping, new.longest)
        with torch.no_grad():
            better = cost_of(new.residuals(moved.unsqueeze(0), y)[0]) < cost
        x, damping = torch.where(better[..., None], moved, x), adapt_damping(damping, better)
    return new, x


@torch.no_grad()
def _chi2(fit: WindowFit, x: Tensor, y: Tensor) -> Tensor:
    """χ² per degree of freedom (S, N)."""
    data = fit.differences(fit.states(x, y), y).square().sum(-1)
    return data / (fit.observations - fit.missing(y) - fit.sizes[0] - fit.sizes[2]).clamp_min(1)


@torch.no_grad()
def _difference(reference: WindowFit, other: WindowFit, x: Tensor, x_other: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
    """Sums over time of F_a² and of its change (S, N), along the windows as the first fit explains them."""
    states, u = reference.states(x, y), inputs_of(reference.system, y)
    rates = [_rates(fit, fit.parts(at, fit.first(y)), states, u) for fit, at in ((reference, x), (other, x_other))]
    first, change = rates[0], rates[1] - rates[0]
    return tuple(rate.square().flatten(3).sum((0, -1)) for rate in (first, change))  # type: ignore[return-value]


def _rates(fit: WindowFit, parts: tuple[Tensor, Tensor, Tensor], states: Tensor, u: Tensor | None) -> Tensor:
    """F_a (T, S, N, *state) at states, with known inputs u (T, S, N, U) where there are some."""
    decoder = fit.decoder
    assert decoder.interaction is not None
    context = decoder.context(parts[1], parts[0])
    inputs = [None] * len(states) if u is None else u
    at = zip(fit.t, states, inputs, strict=True)
    return torch.stack([decoder.interaction_rate(state, context, s, u_t) for s, state, u_t in at])
