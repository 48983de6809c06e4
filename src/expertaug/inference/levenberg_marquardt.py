"""Levenberg–Marquardt for many small problems at once (Marquardt 1963), with derivatives by finite differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

# (x (C, …, B', K), columns (…, B')) → residuals (C, …, B', M): C candidates each for the chosen problems of the last
# axis, which are others in each row of the axes before.
Residuals = Callable[[Tensor, Tensor], Tensor]

DIFFERENCE = 1e-6  # of a parameter, for its derivative in double precision; parameters are of order one
DAMPING, LESS, MORE = 1e-2, 0.2, 4.0  # the first damping, and its factors after a better and after a worse step
TIGHTEST = 1e8  # a problem that no step under this damping betters is at its minimum
LONGEST = 0.5  # step of one parameter
LARGEST = 1e4  # of a residual: a candidate that runs away counts as very bad, not as infinite


@dataclass(frozen=True)
class Minimum:
    """Where the sum of squares is least.

    Attributes:
        x: (…, B, K).
        cost: sum of squared residuals there, (…, B).
        curvature: JᵀJ there, (…, B, K, K): half the second derivative, without the residuals' own.
        moved: whether any step was better than the start, (…, B), bool.
    """

    x: Tensor
    cost: Tensor
    curvature: Tensor
    moved: Tensor


@torch.no_grad()
def minimise(
    residuals: Residuals, x: Tensor, steps: int, longest: float | Tensor = LONGEST, tolerance: float = 1e-6
) -> Minimum:
    """Minimise the sum of squared residuals of every problem from its own start.

    Each step solves once for the trial point and its derivatives; problems that are done are left out of the next, but
    for as many of a row as another one, a seed, has more that are not.

    Arguments:
        residuals: of candidates; what is not finite counts as :data:`LARGEST`.
        x: starts (…, B, K), float64, of order one.
        steps: at most so many.
        longest: step of each parameter, or of all.
        tolerance: a problem is done when a step betters it by less than this share, or, of one that is hardly damped,
            when a linear model does not promise more.
    """
    x = x.clone()
    cost, curvature, slope = linearise(residuals, x)
    damping = torch.full_like(cost, DAMPING)
    done, moved = (torch.zeros_like(cost, dtype=torch.bool) for _ in range(2))
    for _ in range(steps):
        step, gain = _step(curvature, slope, damping, longest)
        done |= (gain <= tolerance * cost) & (damping <= DAMPING)
        most = int((~done).sum(-1).max())
        if not most:
            break
        # Each row's own first, in their order.
        open_ = (~done).int().argsort(dim=-1, descending=True, stable=True)[..., :most]
        now, at, over = (_of(values, open_) for values in (cost, damping, done))
        trial = _of(x + step, open_)
        new, new_curvature, new_slope = _derivatives(residuals, trial, open_)
        better = (new < now) & ~over
        for kept, value in ((x, trial), (curvature, new_curvature), (slope, new_slope), (cost, new)):
            chosen = better.view(*better.shape, *[1] * (value.dim() - better.dim()))
            _put(kept, open_, torch.where(chosen, value, _of(kept, open_)))
        at = torch.where(better, at * LESS, at * MORE)
        _put(damping, open_, torch.where(over, _of(damping, open_), at))
        _put(moved, open_, _of(moved, open_) | better)
        _put(done, open_, over | (better & (now - new <= tolerance * now)) | (at > TIGHTEST))
    return Minimum(x, cost, curvature, moved)


def _places(values: Tensor, columns: Tensor) -> Tensor:
    """Columns (…, B') as places in values (…, B, …)."""
    rest = values.shape[columns.dim() :]
    return columns.view(*columns.shape, *[1] * len(rest)).expand(*columns.shape, *rest)


def _of(values: Tensor, columns: Tensor) -> Tensor:
    return values.gather(columns.dim() - 1, _places(values, columns))


def _put(values: Tensor, columns: Tensor, new: Tensor) -> None:
    values.scatter_(columns.dim() - 1, _places(values, columns), new)


@torch.no_grad()
def trial(residuals: Residuals, x: Tensor, damping: Tensor, longest: float | Tensor = LONGEST) -> tuple[Tensor, Tensor]:
    """One step that its caller is to accept or not (:func:`adapt_damping`): where it leads (…, B, K), and the cost
    (…, B) from where it starts.

    Arguments:
        x: parameters (…, B, K).
        damping: of each problem, (…, B).
    """
    cost, curvature, slope = linearise(residuals, x)
    return x + _step(curvature, slope, damping, longest)[0], cost


def adapt_damping(damping: Tensor, better: Tensor) -> Tensor:
    """The damping (…, B) of the next step, after one that was ``better`` (…, B) or was not."""
    return torch.where(better, damping * LESS, damping * MORE).clamp(1 / TIGHTEST, TIGHTEST)


def _derivatives(residuals: Residuals, x: Tensor, columns: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Cost (…, B), JᵀJ (…, B, K, K) and Jᵀr (…, B, K) by forward differences."""
    size = x.shape[-1]
    moves = torch.cat((x.new_zeros(1, size), DIFFERENCE * torch.eye(size, dtype=x.dtype, device=x.device)))
    values = _limit(residuals(x + moves.view(size + 1, *[1] * (x.dim() - 1), size), columns))
    here = values[0]
    jacobian = ((values[1:] - here) / DIFFERENCE).movedim(0, -1)  # (…, B, M, K)
    transposed = jacobian.transpose(-1, -2)
    return here.square().sum(-1), transposed @ jacobian, (transposed @ here.unsqueeze(-1)).squeeze(-1)


def linearise(residuals: Residuals, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Cost (…, B), JᵀJ (…, B, K, K) and Jᵀr (…, B, K) at parameters x (…, B, K)."""
    return _derivatives(residuals, x, torch.arange(x.shape[-2], device=x.device).expand(x.shape[:-1]))


def of_columns(values: Tensor, columns: Tensor | slice) -> Tensor:
    """The chosen problems, columns (S, B') or all, of values (…, S, B, …) whose first axis is of times."""
    if isinstance(columns, slice):
        return values
    return values[:, torch.arange(len(columns), device=columns.device).unsqueeze(1), columns]


def cost_of(residuals: Tensor) -> Tensor:
    """The sum of squares (…) of residuals (…, M), as the steps compare it."""
    return _limit(residuals).square().sum(-1)


def _limit(residuals: Tensor) -> Tensor:
    return residuals.nan_to_num(LARGEST, LARGEST, -LARGEST).clamp(-LARGEST, LARGEST)


def _step(curvature: Tensor, slope: Tensor, damping: Tensor, longest: float | Tensor) -> tuple[Tensor, Tensor]:
    """The damped step (…, B, K), damping in proportion to the curvature of each parameter, and the decrease of the
    cost that a linear model promises of one that is neither damped nor limited, (…, B)."""
    if not slope.shape[-1]:  # all is known but what the windows share
        return slope, slope.sum(-1)
    diagonal = curvature.diagonal(dim1=-2, dim2=-1)
    # What moves nothing gets a damping of its own, or the matrix would be singular.
    floor = 1e-9 * diagonal.amax(-1, keepdim=True).clamp_min(1e-30)
    damped = curvature + torch.diag_embed(damping[..., None] * diagonal + floor)
    step = -torch.linalg.solve_ex(damped, slope.unsqueeze(-1)).result.squeeze(-1)
    gain = -(slope * step).sum(-1)
    limit = torch.as_tensor(longest).to(step)
    return step.nan_to_num(0.0, 0.0, 0.0).clamp(-limit, limit), gain
