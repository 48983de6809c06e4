"""First steps of F_a, on forecasts from each measured point to the next.

Where the expert alone leads far from the data, forecasts of a whole window hardly say which F_a is better.  From a
measured point to the next one they say it well, and all at once (teacher forcing: Williams and Zipser 1989; Varah 1982
has the slopes in place of the next points).  Noise in the points biases what is learned so; it is a start.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterable

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.inference.coordinates import seen_components
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
OWN = 3.0  # times F_a's: learning rate of z_a
PULL = 1e-3  # weight of z_a's prior beside the mean squared increment
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
    """Learn F_a, the decoder of ``fit``, and the windows' z_a from each measured point to the next; z_e stays as it is.

    Arguments:
        windows: of the training set (T1, 1, N, *observed), float64.
        x: the windows' own coordinates (S, N, K).
        batches: numbers of windows (S, B), of each step.
        name: for messages.

    Returns: x with what was learned of z_a, and first points as they are measured.
    """
    p, q, _ = fit.sizes
    windows = windows[: len(fit.t), 0]
    parameters = [v for v in fit.decoder.parameters() if v.requires_grad]
    before, latent = x[..., :p], x[..., p : p + q].clone().requires_grad_(True)
    measured = torch.zeros_like(x[..., p + q :])
    optimiser = Adam([{"params": parameters}, {"params": [latent]}], lr=settings.learning_rate)
    unit = _increments(fit.system, states_of(fit.system, windows))
    alive, rows = torch.ones(len(x), dtype=torch.bool), torch.arange(len(x)).unsqueeze(1)
    started = told = time.monotonic()
    for step, index in zip(range(settings.steps), batches, strict=False):
        batch, own = windows[:, index], torch.cat((before, latent, measured), -1)[rows, index]
        observed, u = states_of(fit.system, batch), inputs_of(fit.system, batch)
        z_e, z_a, _ = fit.parts(own, fit.first(batch))
        states = fit.decoder.state_of(observed)
        known = torch.isfinite(states[:-1]).flatten(3).all(-1)
        aim = torch.where(known.view(*known.shape, *[1] * (observed.dim() - 3)), observed[1:], math.nan)
        found = _next_points(fit, states.nan_to_num(0.0), z_e.expand(*z_a.shape[:2], -1), z_a, u)
        difference, _ = differences(fit.system, found, aim)
        fitted = (difference / unit).square().movedim(1, 0).flatten(1).mean(1)
        pull = own[..., p : p + q].square().flatten(1).sum(1) / max(q * index.shape[1], 1)
        optimiser.zero_grad(set_to_none=True)
        (fitted + PULL * pull).sum().backward()
        clip_each_seed(parameters, CLIP, alive)
        rate = settings.learning_rate * one_cycle(step, settings.steps, WARMUP)
        for group, factor in zip(optimiser.param_groups, (1.0, OWN), strict=True):
            group["lr"] = factor * rate
        optimiser.step()
        if time.monotonic() - told > PROGRESS_S or step + 1 == settings.steps:
            told = time.monotonic()
            message = "%s: from point to point, step %d/%d, loss %.4g, %d s gone"
            logger.info(message, name, step + 1, settings.steps, fitted.detach().mean(), told - started)
    return torch.cat((before, latent.detach(), measured), -1)


def _increments(system: System, y: Tensor) -> Tensor:
    """Root mean square of what each observed quantity of windows y (T1, N, *state) changes from a point to the next."""
    steps, _ = differences(system, y[1:, None], y[:-1, None])
    axes = [axis for axis in range(steps.dim()) if axis != 3]
    return steps.square().nan_to_num(0.0).mean(axes).sqrt().clamp_min(1e-12).view(-1, *[1] * (steps.dim() - 4))


def _next_points(fit: WindowProblem, states: Tensor, z_e: Tensor, z_a: Tensor, u: Tensor | None) -> Tensor:
    """Forecasts (T1 − 1, S, B, *state) of each state (T1, S, B, *state) but the first, from the one before."""
    start, t, decoder = states[:-1], fit.t, fit.decoder
    times, count = len(start), start.shape[2]
    steps = t.diff()
    if u is None and not getattr(decoder.interaction, "sees_time", False) and torch.allclose(steps, steps[0]):
        # The same step everywhere: the states of all times are so many samples.
        wide = start.movedim(0, 1).flatten(1, 2)
        z_e, z_a = (z.repeat(1, times, 1) for z in (z_e, z_a))
        found = forecast_or_fallback(decoder, wide, z_e, z_a, t[:2], fit.solver, None)[1]
        found = found.unflatten(1, (times, count)).movedim(1, 0)
    else:
        inputs = [None] * times if u is None else [u[i : i + 2] for i in range(times)]
        pairs = [(start[i], z_e, z_a, t[i : i + 2], fit.solver, inputs[i]) for i in range(times)]
        found = torch.stack([forecast_or_fallback(decoder, *pair)[1] for pair in pairs])
    return found
