"""Squared errors where the truth was measured, and residuals of the observed window, by which alarms work."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from expertaug.learning.divergence import BoundedSolver, bound_of_card, clamp_to_bound, solve_with_sample_fallback
from expertaug.models.posterior import Estimates, Predictor
from expertaug.models.store import StoredModel
from expertaug.systems import System
from expertaug.windows import Windows

KEPT_WINDOWS = 500  # validation windows whose misfits a model file keeps, evenly spread
AT_A_TIME = 256  # windows at a time


def mean_squared_error(
    system: System, prediction: Tensor, truth: Tensor, good: Tensor | None = None, complete: bool = False
) -> Tensor:
    """Mean over times, samples and dimensions of the squared error of observed quantities, where they were measured.

    Arguments:
        prediction, truth: (T, S, B, *state); the truth is NaN where nothing was measured.
        good: (S, B), the samples that count; all of them where it is None.
        complete: whether it is known that the truth has no NaN.

    Returns:
        (S,).
    """
    difference, measured = differences(system, prediction, truth, complete)
    error = difference.square().movedim(1, 0)
    if measured is not None:
        counts = measured.sum((0, *range(3, measured.dim())))
        sums = error.movedim(2, 1).flatten(2).sum(2)
        if good is not None:
            sums, counts = (torch.where(good, each, torch.zeros_like(each)) for each in (sums, counts))
        return sums.sum(1) / counts.sum(1).clamp_min(1)
    if good is None:
        return error.flatten(1).mean(1)
    return sample_mean(error.movedim(2, 1).flatten(2).mean(2), good)


def differences(
    system: System, prediction: Tensor, truth: Tensor, complete: bool = False
) -> tuple[Tensor, Tensor | None]:
    """Observed quantities of forecasts less those of the truth (T, S, B, *observed), 0 where these are NaN; and which
    of them are not, None where all are known (``complete``: it need not be looked for)."""
    observed = system.observe(truth)
    difference = system.observe(prediction) - observed
    if complete:
        return difference, None
    measured = ~torch.isnan(observed)
    if measured.all():
        return difference, None
    return torch.where(measured, difference, torch.zeros_like(difference)), measured.expand_as(difference)


def squares(system: System, prediction: Tensor, truth: Tensor, complete: bool = False) -> tuple[Tensor, Tensor | int]:
    """Squared errors (S, B) of every sample, summed over times and observed quantities; and how many are summed, (S, B)
    where samples differ in that; ``complete`` as of :func:`differences`."""
    difference, measured = differences(system, prediction, truth, complete)
    error = difference.square().flatten(3)
    count = error.shape[0] * error.shape[3] if measured is None else measured.flatten(3).sum((0, 3))
    return error.sum((0, 3)), count


def sample_mean(each: Tensor, good: Tensor | None = None) -> Tensor:
    """Mean (S,) over the samples that count of (S, B); over all of them where ``good`` is None."""
    if good is None:
        return each.mean(1)
    return torch.where(good, each, torch.zeros_like(each)).sum(1) / good.sum(1).clamp_min(1)


def squared_errors(system: System, prediction: Tensor, truth: Tensor) -> Tensor:
    """Squared error of every sample, summed over the observed dimensions and averaged over time: (S, N), float64.

    Where nothing was measured (a truth of NaN) nothing counts: each dimension's error is the mean over the times that
    have one; a sample without any is NaN.

    Arguments:
        prediction, truth: states (T, S, N, *state).
    """
    difference, measured = differences(system, prediction, truth)
    error = difference.double().square()
    if measured is not None:
        counts = measured.sum(0)
        sums = (error.sum(0) / counts.clamp_min(1)).flatten(2).sum(-1)
        return sums.masked_fill(counts.flatten(2).sum(-1) == 0, torch.nan)
    return error.flatten(3).sum(-1).mean(0)


def window_residual(system: System, states: Tensor, windows: Tensor) -> Tensor:
    """The misfit (S, N) of forecasts (T, S, N, *state) of windows (T1, S, N, *state): their squared error over the
    observed points after the first."""
    return squared_errors(system, states[1 : len(windows)], windows[1:])


@torch.no_grad()
def observed_residuals(stored: StoredModel, windows: Windows) -> Tensor:
    """The misfit (S, N) of windows that all seeds share, y (T1, 1, N, *state), by a model's own estimates."""
    model: Predictor = stored.model
    system: System = model.system  # type: ignore[attr-defined]
    bound, parts = bound_of_card(stored.card, windows.y.device), []
    t = torch.tensor(stored.card.t[: windows.points], dtype=torch.float32, device=windows.y.device)
    windows = replace(windows.until(windows.points), t=t)
    for shared in windows.split(AT_A_TIME):
        part = shared.expand(len(stored.seeds))
        estimates = model.estimate(part)  # type: ignore[attr-defined]

        def predicted(
            samples: slice, solver: BoundedSolver, estimates: Estimates = estimates, part: Windows = part
        ) -> Tensor:
            return model.predicted(estimates.part(samples), part.samples(samples), solver)  # type: ignore[arg-type]

        states, _ = solve_with_sample_fallback(predicted, part.y.shape[2], stored.solver, bound)
        parts.append(window_residual(system, clamp_to_bound(states, bound), part.y))
    return torch.cat(parts, dim=1)


def record_residuals(stored: StoredModel, windows: Windows) -> Mapping[str, list[list[float]]]:
    """What a model file says of validation windows that all seeds share, y (T1, 1, N, *state): their misfits, a list a
    seed.  A window of which nothing was measured after its first point has none."""
    system: System = stored.model.system  # type: ignore[assignment]
    unseen = torch.isnan(system.observe(windows.y[1:])).movedim(2, 0).flatten(1).all(1)
    windows = windows.samples(~unseen) if unseen.any() else windows
    count = windows.y.shape[2]
    index = torch.linspace(0, count - 1, min(KEPT_WINDOWS, count)).long()
    residuals = observed_residuals(stored, windows.samples(index.to(windows.y.device))).nan_to_num(1e30, 1e30)
    return {"validation": [[float(f"{value:.6g}") for value in seed] for seed in residuals.tolist()]}
