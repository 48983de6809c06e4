"""Squared errors of forecasts, where the truth was measured."""

from __future__ import annotations

import torch
from torch import Tensor

from expertaug.systems import System


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
    difference, known = differences(system, prediction, truth, complete)
    error = difference.square().movedim(1, 0)
    if known is not None:
        counts = known.sum((0, *range(3, known.dim())))
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
    known = ~torch.isnan(observed)
    if known.all():
        return difference, None
    return torch.where(known, difference, torch.zeros_like(difference)), known.expand_as(difference)


def squares(system: System, prediction: Tensor, truth: Tensor, complete: bool = False) -> tuple[Tensor, Tensor | int]:
    """Squared errors (S, B) of every sample, summed over times and observed quantities; and how many are summed, (S, B)
    where samples differ in that; ``complete`` as of :func:`differences`."""
    difference, known = differences(system, prediction, truth, complete)
    error = difference.square().flatten(3)
    count = error.shape[0] * error.shape[3] if known is None else known.flatten(3).sum((0, 3))
    return error.sum((0, 3)), count


def sample_mean(each: Tensor, good: Tensor | None = None) -> Tensor:
    """Mean (S,) over the samples that count of (S, B); over all of them where ``good`` is None."""
    if good is None:
        return each.mean(1)
    return torch.where(good, each, torch.zeros_like(each)).sum(1) / good.sum(1).clamp_min(1)
