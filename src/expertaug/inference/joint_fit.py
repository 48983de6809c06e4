"""The minimum of windows' sum of squares over what they share and what is their own, by Gauss and Newton's steps.

Given what is shared, windows are independent, so that their own parameters are eliminated from the normal equations
window by window (a Schur complement), and, where windows of a trajectory share some, these from what is left,
trajectory by trajectory; what is left then is a system of the size of what all share.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from expertaug.inference.levenberg_marquardt import DAMPING, LESS, MORE, TIGHTEST, linearise, minimise, of_columns
from expertaug.inference.sensed_fit import SensedFit
from expertaug.inference.window_problem import MEMORY, WindowProblem
from expertaug.models.fit_settings import Constant

STEPS = 60
TOLERANCE = 1e-9  # of the cost: the windows together are at their minimum
FEWEST_GROUPS = 8  # of windows whose residuals are independent, below which blocks of windows stand for groups
BLOCKS = 10


@dataclass(frozen=True)
class NormalEquations:
    """The problem in its linear approximation: of N windows with K coordinates each, M of them shared.

    Attributes:
        cost: sum of squares of each window, (N,).
        curvature: JᵀJ, (N, K, K).
        slope: Jᵀr, (N, K).
    """

    cost: Tensor
    curvature: Tensor
    slope: Tensor

    def of(self, places: Sequence[int]) -> NormalEquations:
        """Of some of the coordinates, the others held."""
        some = list(places)
        return NormalEquations(self.cost, self.curvature[:, some][:, :, some], self.slope[:, some])


@dataclass(frozen=True)
class Tied:
    """Coordinates that all windows of a trajectory have in common.

    Attributes:
        places: of the coordinates.
        groups: number of each window's trajectory, (N,), from 0 on without a gap.
    """

    places: Sequence[int]
    groups: Tensor

    @classmethod
    def of(cls, places: Sequence[int], trajectories: Mapping[str, np.ndarray]) -> Tied:
        """Of the windows' places by trajectory."""
        groups = torch.zeros(sum(map(len, trajectories.values())), dtype=torch.long)
        for k, windows in enumerate(trajectories.values()):
            groups[torch.from_numpy(windows)] = k
        return cls(places, groups)

    @property
    def count(self) -> int:
        """Number of trajectories."""
        return int(self.groups.max()) + 1

    @property
    def first(self) -> Tensor:
        """A window of each trajectory."""
        return torch.stack([(self.groups == k).nonzero()[0, 0] for k in range(self.count)])

    def alike(self, x: Tensor) -> Tensor:
        """Coordinates (1, N, K) with the median of each trajectory's windows at these places."""
        x = x.clone()
        for k in range(self.count):
            windows = self.groups == k
            for place in self.places:
                x[:, windows, place] = x[:, windows, place].median()
        return x

    def summed(self, equations: NormalEquations) -> NormalEquations:
        """Of what windows say of the same coordinates: of each trajectory."""

        def total(values: Tensor) -> Tensor:
            return values.new_zeros(self.count, *values.shape[1:]).index_add_(0, self.groups, values)

        return NormalEquations(total(equations.cost), total(equations.curvature), total(equations.slope))

    def variances(self, equations: NormalEquations, places: Sequence[int], overdispersion: float) -> Tensor:
        """Of each window's coordinates at these places, (N, M), the shared ones being held: by the curvature, or, where
        it is larger, by how blocks of the trajectory's windows scatter.

        Arguments:
            overdispersion: by how much less residuals tell than independent ones of the stated noise.
        """
        kept = [k for k in range(equations.slope.shape[1]) if k not in places]
        part, at = equations.of(kept), [kept.index(k) for k in self.places]
        variances = part.slope.new_zeros(len(part.cost), len(at))
        for k in range(self.count):
            windows = self.groups == k
            own = NormalEquations(part.cost[windows], part.curvature[windows], part.slope[windows])
            count = len(own.cost)
            blocks = np.arange(count) * BLOCKS // count if count >= FEWEST_GROUPS else np.zeros(count, dtype=int)
            least = overdispersion * clustered_variances(own, at, np.zeros(count, dtype=int))
            variances[windows] = torch.maximum(least, clustered_variances(own, at, blocks))
        return variances

    def constants(self, values: Tensor, errors: Tensor, names: Sequence[str]) -> dict[str, Constant]:
        """By trajectory, of values and errors (N,) of its windows."""
        counts = torch.bincount(self.groups).tolist()
        pairs = zip(names, values[self.first].tolist(), errors[self.first].tolist(), counts, strict=True)
        return {name: Constant(value=value, std=error, groups=count) for name, value, error, count in pairs}


@torch.no_grad()
def minimise_together(
    fit: WindowProblem | SensedFit,
    windows: Tensor,
    x: Tensor,
    places: Sequence[int],
    tolerance: float = TOLERANCE,
    steps: int = STEPS,
    tied: Tied | None = None,
) -> tuple[Tensor, NormalEquations, bool]:
    """Coordinates (1, N, K) at the minimum of all windows' sum of squares, the equations there, and whether it is one.

    Arguments:
        fit: the windows' problems.
        windows: (T, 1, N, *observed), float64.
        x: where to start, (1, N, K), the same for all windows at the shared places.
        places: of the shared coordinates.
        tolerance: of the cost, within which the windows together are at their minimum.
        steps: at most so many.
        tied: coordinates of trajectories, where x is the same for all of its windows.
    """
    if not places and tied is None:
        x = minimise_each(fit, windows, x)
        return x, normal_equations(fit, windows, x), True
    now, damping, done = normal_equations(fit, windows, x), DAMPING, False
    for _ in range(steps):
        trial = x + _step(now, places, damping, fit.longest, tied)
        new = normal_equations(fit, windows, trial)
        gain = float(now.cost.sum() - new.cost.sum())
        if gain > 0:
            x, now, damping = trial, new, damping * LESS
        else:
            damping *= MORE
        done = damping > TIGHTEST or 0 < gain <= tolerance * float(now.cost.sum())
        if done:
            break
    return x, now, done


@torch.no_grad()
def minimise_each(
    fit: WindowProblem | SensedFit, windows: Tensor, x: Tensor, fixed: Sequence[int] = (), steps: int = STEPS
) -> Tensor:
    """Coordinates (1, N, K) at each window's own minimum, after at most so many steps, some of them held."""
    own = [k for k in range(x.shape[-1]) if k not in fixed]
    if not own:
        return x
    parts, size = [], max(1, MEMORY // (windows[:, :, :1].numel() * 8 * (len(own) + 1)))
    for first in range(0, x.shape[1], size):
        some, held = windows[:, :, first : first + size], x[:, first : first + size]

        def residuals(candidates: Tensor, columns: Tensor, some: Tensor = some, held: Tensor = held) -> Tensor:
            whole = held[:, columns[0]].expand(len(candidates), -1, -1, -1).clone()
            whole[..., own] = candidates
            return fit.residuals(whole, of_columns(some, columns))

        minimum = held.clone()
        minimum[..., own] = minimise(residuals, held[..., own], steps, fit.longest[own]).x
        parts.append(minimum)
    return torch.cat(parts, dim=1)


@torch.no_grad()
def normal_equations(fit: WindowProblem | SensedFit, windows: Tensor, x: Tensor) -> NormalEquations:
    """The equations of windows (T, 1, N, *observed) at coordinates (1, N, K)."""
    parts, size = [], max(1, MEMORY // (windows[:, :, :1].numel() * 8 * (x.shape[-1] + 1)))
    for first in range(0, x.shape[1], size):
        some = windows[:, :, first : first + size]

        def residuals(candidates: Tensor, columns: Tensor, some: Tensor = some) -> Tensor:
            return fit.residuals(candidates, of_columns(some, columns))

        parts.append(linearise(residuals, x[:, first : first + size]))
    return NormalEquations(*(torch.cat([part[k][0] for part in parts]) for k in range(3)))


def eliminate(
    equations: NormalEquations, places: Sequence[int], damping: float
) -> tuple[Tensor, Tensor, Tensor, Tensor, list[int]]:
    """What each window says of the shared coordinates once its own are eliminated: curvature (N, M, M) and slope
    (N, M); how its own follow, (N, K − M, M) and (N, K − M); and the places of its own."""
    own = [k for k in range(equations.slope.shape[1]) if k not in places]
    curvature, slope = equations.curvature, equations.slope
    inner = curvature[:, own][:, :, own]
    diagonal = inner.diagonal(dim1=1, dim2=2)
    floor = 1e-9 * diagonal.amax(-1, keepdim=True).clamp_min(1e-30) if own else diagonal
    inner = inner + torch.diag_embed(damping * diagonal + floor)
    across = curvature[:, own][:, :, places]
    follow = torch.linalg.solve(inner, across)
    rest = torch.linalg.solve(inner, slope[:, own].unsqueeze(-1)).squeeze(-1)
    reduced = curvature[:, places][:, :, places] - across.mT @ follow
    left = slope[:, places] - (across.mT @ rest.unsqueeze(-1)).squeeze(-1)
    return reduced, left, follow, rest, own


def _step(
    equations: NormalEquations, places: Sequence[int], damping: float, longest: Tensor, tied: Tied | None = None
) -> Tensor:
    """The damped step (1, N, K)."""
    step, count = torch.zeros_like(equations.slope), len(equations.cost)
    if tied is None:
        reduced, left, follow, rest, own = eliminate(equations, places, damping)
        shared = _shared_step(reduced, left, damping, longest[list(places)])
        outer, moved, along = list(places), shared.expand(count, -1), follow @ shared
    else:
        outer, size = [*tied.places, *places], len(tied.places)
        reduced, left, follow, rest, own = eliminate(equations, outer, damping)
        each = tied.summed(NormalEquations(equations.cost, reduced, left))
        reduced, left, follow_group, rest_group, _ = eliminate(each, range(size, len(outer)), damping)
        shared = _shared_step(reduced, left, damping, longest[list(places)])
        limit = longest[list(tied.places)]
        of_each = -(rest_group + follow_group @ shared).clamp(-limit, limit)
        moved = torch.cat((of_each[tied.groups], shared.expand(count, -1)), dim=-1)
        along = (follow @ moved.unsqueeze(-1)).squeeze(-1)
    step[:, outer] = moved
    step[:, own] = -(rest + along)
    return step.nan_to_num(0.0, 0.0, 0.0).clamp(-longest, longest).unsqueeze(0)


def _shared_step(reduced: Tensor, left: Tensor, damping: float, limit: Tensor) -> Tensor:
    """Of the shared coordinates, (M,), by what each window or trajectory says of them."""
    total = reduced.sum(0)
    if not len(total):
        return left.sum(0)
    damped = total + torch.diag(damping * total.diagonal() + 1e-12 * total.diagonal().amax())
    return -torch.linalg.solve(damped, left.sum(0)).clamp(-limit, limit)


def of_groups(
    equations: NormalEquations, places: Sequence[int], tied: Tied | None
) -> tuple[NormalEquations, Sequence[int]]:
    """Equations in which whatever tells shared coordinates apart is a row: windows, or trajectories where windows have
    something in common; and the places of the shared coordinates there."""
    if tied is None:
        return equations, places
    outer = [*tied.places, *places]
    reduced, left, *_ = eliminate(equations, outer, 0.0)
    return tied.summed(NormalEquations(equations.cost, reduced, left)), range(len(tied.places), len(outer))


def clustered_variances(equations: NormalEquations, places: Sequence[int], groups: np.ndarray) -> Tensor:
    """Of the shared coordinates, (M,), from how the groups' slopes scatter, as leaving each group out once would tell
    (Bell & McCaffrey 2002): errors are not too small where groups are few.  Where few of them tell a constant their
    scatter is often too small by chance: never less than what the noise alone makes, by the curvature."""
    reduced, left, *_ = eliminate(equations, places, 0.0)
    inverse = torch.linalg.pinv(reduced.sum(0))
    numbers = torch.from_numpy(np.unique(groups, return_inverse=True)[1])
    count, size = int(numbers.max()) + 1, len(places)
    least = inverse.diagonal().clamp_min(0)
    if count == 1:
        return least
    slopes = torch.zeros(count, size, dtype=left.dtype).index_add_(0, numbers, left)
    curvatures = torch.zeros(count, size, size, dtype=left.dtype).index_add_(0, numbers, reduced)
    others = torch.eye(size, dtype=left.dtype) - curvatures @ inverse
    slopes = (torch.linalg.pinv(others) @ slopes.unsqueeze(-1)).squeeze(-1)
    scatter = (count - 1) / count * inverse @ (slopes.mT @ slopes) @ inverse
    return torch.maximum(scatter.diagonal(), least)
