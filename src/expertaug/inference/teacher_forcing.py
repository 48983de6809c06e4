"""First steps of F_a, on forecasts from each measured point to the next.

Where the expert alone leads far from the data, forecasts of a whole window hardly say which F_a is better.  From a
measured point to the next one they say it well, and all at once (teacher forcing: Williams and Zipser 1989; Varah 1982
has the slopes in place of the next points).  So do they of a window's own parameters: what an expert lacks adds up over
a window, and bends its constants.  Noise in the points biases what is learned so; it is a start.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterable
from functools import partial

import numpy as np
import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.inference.coordinates import seen_components
from expertaug.inference.levenberg_marquardt import DAMPING, adapt_damping, cost_of, minimise, of_columns, trial
from expertaug.inference.settings import TeacherForcing
from expertaug.inference.window_problem import WindowProblem
from expertaug.learning.divergence import forecast_or_fallback
from expertaug.learning.optimiser import Adam, clip_each_seed
from expertaug.learning.residuals import differences
from expertaug.learning.settings import one_cycle
from expertaug.systems import System
from expertaug.systems.inputs import inputs_of, states_of

logger = logging.getLogger(__name__)
WARMUP = 0.1  # share of the steps
PULL = 1e-3  # weight of z_a's prior beside the mean squared error, in units of the increments
OWN = 3.0  # times F_a's: learning rate of z_a
FIRST_STEPS = 8  # of Levenberg and Marquardt, at most, of the expert alone
CLIP = 5.0  # largest norm of a seed's gradient
PROGRESS_S = 10.0


def check_measured(system: System, windows: Tensor) -> None:
    """Refuse windows (T1, 1, N, *observed), NaN where nothing was measured, in which no forecast can begin.

    Raises:
        InputError: a component that the system does not observe, or that nobody measured.
    """
    measured = torch.isfinite(states_of(system, windows)).movedim(3, 0).flatten(1).any(1)
    seen = (seen_components(system) & measured).tolist()
    hidden = [part.name for part, is_seen in zip(system.state, seen, strict=True) if not is_seen]
    if hidden:
        problem = f"forecasts begin at measured points, and nobody measured {', '.join(hidden)}"
        raise InputError("alternation.teacher_forcing", problem, "leave it out")


def learn_next_points(
    fit: WindowProblem,
    windows: Tensor,
    x: Tensor,
    batches: Iterable[Tensor],
    settings: TeacherForcing,
    name: str = "",
) -> Tensor:
    """Learn F_a, the decoder of ``fit``, and what windows have of their own, from each measured point to the next.

    Arguments:
        windows: of the training set (T1, 1, N, *observed), float64.
        x: the windows' own coordinates (S, N, K).
        batches: numbers of windows (S, B), of each step.
        name: for messages.

    Returns: x with what was learned of z_e and z_a, and first points as they are measured.
    """
    p, q, _ = fit.sizes
    windows = windows[: len(fit.t)]
    parameters = [v for v in fit.decoder.parameters() if v.requires_grad]
    own, measured = x[..., : p + q].clone(), torch.zeros_like(x[..., p + q :])
    by_gradient = settings.estimates == "gradient"
    z_a = own[..., p:].clone().requires_grad_(by_gradient)
    damping = torch.full(own.shape[:2], DAMPING, dtype=torch.float64)
    groups = [{"params": parameters}, *([{"params": [z_a]}] if by_gradient else [])]
    optimiser = Adam(groups, lr=settings.learning_rate)
    unit = _increments(fit.system, states_of(fit.system, windows[:, 0]))
    alive, rows = torch.ones(len(x), dtype=torch.bool), torch.arange(len(x)).unsqueeze(1)
    started = told = time.monotonic()
    for step, index in zip(range(settings.steps), batches, strict=False):
        some = _some_of(len(windows) - 1, settings.points, step)
        pairs = _Pairs(fit, windows[:, 0][:, index], some, unit)
        if by_gradient:
            found = torch.cat((own[..., :p], z_a), -1)[rows, index]
            fitted = pairs.errors(found).square().sum(-1).mean(1)
            loss = fitted + pairs.pull(found).square().sum(-1).mean(1)
        else:
            before = own[rows, index]
            found, cost = trial(pairs.residuals, before, damping[rows, index], fit.longest[: p + q])
            errors = pairs.errors(found)
            better = cost_of(torch.cat((errors.detach(), pairs.pull(found)), -1)) < cost
            better |= not found.shape[-1]
            own[rows, index] = torch.where(better[..., None], found, before)
            damping[rows, index] = adapt_damping(damping[rows, index], better)
            fitted = loss = (errors.square().sum(-1) * better).sum(1) / better.sum(1).clamp_min(1)
        optimiser.zero_grad(set_to_none=True)
        loss.sum().backward()
        clip_each_seed(parameters, CLIP, alive)
        rate = settings.learning_rate * one_cycle(step, settings.steps, WARMUP)
        for group, factor in zip(optimiser.param_groups, (1.0, OWN), strict=False):
            group["lr"] = factor * rate
        optimiser.step()
        if time.monotonic() - told > PROGRESS_S or step + 1 == settings.steps:
            told = time.monotonic()
            message = "%s: from point to point, step %d/%d, loss %.4g, %d s gone"
            logger.info(message, name, step + 1, settings.steps, fitted.detach().mean(), told - started)
    own = torch.cat((own[..., :p], z_a.detach()), -1) if by_gradient else own
    return torch.cat((own, measured), -1)


@torch.no_grad()
def expert_from_points(fit: WindowProblem, windows: Tensor, x: Tensor, batch: int) -> Tensor:
    """Each window's z_e, fitted by the expert alone from each measured point to the next: what it lacks adds up less.

    Arguments:
        fit: of the expert alone, the same for all seeds.
        windows: of the training set (T1, 1, N, *observed), float64.
        x: the windows' own coordinates (S, N, K); the first seed's z_e is where the fits begin.
        batch: windows at a time.

    Returns: x with the z_e found; unchanged where all of z_e is shared.
    """
    p, windows, x = fit.sizes[0], windows[: len(fit.t)], x.clone()
    if not p:
        return x
    unit, every = _increments(fit.system, states_of(fit.system, windows[:, 0])), torch.arange(len(windows) - 1)
    for first in range(0, windows.shape[2], batch):
        some = slice(first, first + batch)
        pairs = _Pairs(fit, windows[:, :1, some], every, unit)
        rest = x[:1, some, p : sum(fit.sizes[:2])]
        residuals = partial(_with_rest, pairs, rest)
        x[..., some, :p] = minimise(residuals, x[:1, some, :p], FIRST_STEPS, fit.longest[:p]).x
    return x


def _with_rest(pairs: _Pairs, rest: Tensor, candidates: Tensor, columns: Tensor) -> Tensor:
    wide = of_columns(rest[None], columns)[0].expand(*candidates.shape[:-1], -1)
    return pairs.residuals(torch.cat((candidates, wide), -1), columns)


class _Pairs:
    """Some points of windows and the next ones.

    Arguments:
        windows: (T1, S, B, *observed).
        some: numbers of the points (P,).
        unit: what each observed quantity changes by from a point to the next, beside states.
    """

    def __init__(self, fit: WindowProblem, windows: Tensor, some: Tensor, unit: Tensor) -> None:
        self.fit, self.some, self.unit = fit, some, unit
        observed = states_of(fit.system, windows)
        starts = fit.decoder.state_of(observed[some])
        known = torch.isfinite(starts).flatten(3).all(-1)
        self.aim = torch.where(known.view(*known.shape, *[1] * (observed.dim() - 3)), observed[some + 1], math.nan)
        self.starts, self.first = starts.nan_to_num(0.0), fit.first(windows)
        self.u = inputs_of(fit.system, windows)

    def errors(self, own: Tensor, columns: Tensor | slice = slice(None)) -> Tensor:
        """Errors of the forecasts with z_e and z_a of coordinates ``own`` (S, C·B', p + q) of the chosen windows, C
        for each; their squares' sum (S, C·B') is a mean."""
        first = of_columns(self.first[None], columns)
        copies = own.shape[1] // first.shape[2]
        starts, aim = (_repeat(of_columns(values, columns), copies) for values in (self.starts, self.aim))
        first = _repeat(first, copies)[0]
        u = None if self.u is None else _repeat(of_columns(self.u, columns), copies)
        measured = own.new_zeros(*own.shape[:2], self.fit.sizes[2])
        z_e, z_a, _ = self.fit.parts(torch.cat((own, measured), -1), first)
        found = _next_points(self.fit, starts, self.some, z_e.expand(*z_a.shape[:2], -1), z_a, u)
        difference, _ = differences(self.fit.system, found, aim)
        errors = (difference / self.unit).movedim(0, 2).flatten(2)
        return errors / math.sqrt(errors.shape[-1])

    def pull(self, own: Tensor) -> Tensor:
        """Residuals of z_a's prior, (S, B, q)."""
        p, q, _ = self.fit.sizes
        return math.sqrt(PULL / max(q, 1)) * own[..., p : p + q]

    def residuals(self, candidates: Tensor, columns: Tensor) -> Tensor:
        """Of candidates (C, S, B', p + q) for the chosen windows, (C, S, B', M)."""
        copies, seeds, count = candidates.shape[:3]
        wide = candidates.movedim(0, 1).flatten(1, 2)
        with torch.no_grad():
            values = torch.cat((self.errors(wide, columns), self.pull(wide)), -1)
        return values.view(seeds, copies, count, -1).movedim(1, 0)


def _repeat(values: Tensor, copies: int) -> Tensor:
    """Values (T, S, B, …), so many times beside each other along the windows."""
    return values.repeat(1, 1, copies, *[1] * (values.dim() - 3))


def _increments(system: System, y: Tensor) -> Tensor:
    """Root mean square of what each observed quantity of windows y (T1, N, *state) changes from a point to the next."""
    steps, _ = differences(system, y[1:, None], y[:-1, None])
    axes = [axis for axis in range(steps.dim()) if axis != 3]
    return steps.square().nan_to_num(0.0).mean(axes).sqrt().clamp_min(1e-12).view(-1, *[1] * (steps.dim() - 4))


def _some_of(count: int, points: int | None, step: int) -> Tensor:
    """Numbers of the points, of ``count``, at which a step's forecasts begin; the same for each seed."""
    if points is None or points >= count:
        return torch.arange(count)
    return torch.from_numpy(np.sort(np.random.default_rng(step).choice(count, points, replace=False)))


def _next_points(
    fit: WindowProblem, starts: Tensor, some: Tensor, z_e: Tensor, z_a: Tensor, u: Tensor | None
) -> Tensor:
    """Forecasts (P, S, B, *state) of the points behind ``some`` (P,), at which they begin at ``starts``."""
    t, decoder = fit.t, fit.decoder
    times, count = len(starts), starts.shape[2]
    steps = t.diff()
    if u is None and not getattr(decoder.interaction, "sees_time", False) and torch.allclose(steps, steps[0]):
        # The same step everywhere: the states of all times are so many samples.
        wide = starts.movedim(0, 1).flatten(1, 2)
        z_e, z_a = (z.repeat(1, times, 1) for z in (z_e, z_a))
        found = forecast_or_fallback(decoder, wide, z_e, z_a, t[:2], fit.solver, None)[1]
        found = found.unflatten(1, (times, count)).movedim(1, 0)
    else:
        inputs = [None if u is None else u[i : i + 2] for i in some.tolist()]
        times_of = [t[i : i + 2] for i in some.tolist()]
        pairs = [(y0, z_e, z_a, when, fit.solver, v) for y0, when, v in zip(starts, times_of, inputs, strict=True)]
        found = torch.stack([forecast_or_fallback(decoder, *pair)[1] for pair in pairs])
    return found
