"""The exact gradient of a solve by explicit steps on a grid, without a graph of the steps.

Of small states a solve and its gradient are mostly dispatch: a call for every operation of every step, forward and
back.  Here the steps are taken without a graph; the rates at all visited states are then computed again at once, with
one; and back from the last step goes a recursion of the states' size alone, with the Jacobians of those rates.  That is
the gradient of the steps as they were taken, to rounding: the discrete adjoint (Sandu, On the properties of Runge-Kutta
discrete adjoints, 2006), not that of a differential equation solved backwards (Chen et al. 2018).

Explicit steps are sums of rates with weights that no state changes.  What these are is not written down by method: a
solve of unit vectors shows them (:class:`Scheme`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np
import torch
from torch import Tensor

from expertaug.systems.settings import FIXED
from expertaug.systems.solvers.solver import Solver

Rates = Callable[[Tensor, Tensor], Tensor]
EXPLICIT = tuple(method for method in FIXED if method != "rodas3")
LARGEST = 8  # components of a state: a Jacobian has their square
NUMBERS = 2**15  # made of all states at a time: where there are more, arithmetic takes the time, and a graph has less
EVALUATIONS = 2048  # of a solve, at most: a scheme is found from as many numbers squared
ROUNDING = 1e-12
EQUAL = 1e-4  # of a rate's size in its sample: by how much one computed again may differ


@dataclass(frozen=True)
class Scheme:
    """A solver's steps on one grid, written out: E evaluations, at points each of which is the one before it and a
    weighted sum of earlier rates.

    Attributes:
        times: of the evaluations in s, (E,).
        earlier: for each point but the first, the first rate that it adds, and the weights of that and the next ones.
        later: for each evaluation, the first point that its rate adds to, and its weights in that and the next ones.
        states: which point each state (T,) of the solve is; the point after the last evaluation is the last state.
    """

    times: Tensor
    earlier: tuple[tuple[int, np.ndarray], ...]
    later: tuple[tuple[int, np.ndarray], ...]
    states: tuple[int, ...]

    @classmethod
    def of(cls, solver: Solver, t: Tensor) -> Scheme | None:
        """Of a solver with explicit steps on the grid t (T,); None where they are none, or too many."""
        times: list[Tensor] = []

        def still(s: Tensor, y: Tensor) -> Tensor:
            times.append(torch.as_tensor(s, dtype=t.dtype))
            return torch.zeros_like(y)

        solver(still, torch.zeros(1, dtype=torch.float64), t)
        if not 0 < len(times) <= EVALUATIONS:
            return None
        units, points = iter(torch.eye(len(times), dtype=torch.float64)), []

        def unit(s: Tensor, y: Tensor) -> Tensor:
            points.append(y)
            return next(units)

        states = solver(unit, torch.zeros(len(times), dtype=torch.float64), t)
        rows = torch.stack((*points, states[-1]))
        places = [int((rows == state).all(-1).nonzero()[0]) for state in states]
        steps = rows.diff(dim=0, prepend=torch.zeros_like(rows[:1])).numpy()
        earlier, later = [_within(step) for step in steps[1:]], [_within(step) for step in steps.T]
        return cls(torch.stack(times), tuple(earlier), tuple(later), tuple(places))

    @np.errstate(all="ignore")  # what runs away is told by its values
    def steps(self, field: Rates, y0: Tensor) -> tuple[Tensor, Tensor]:
        """The points (E + 1, *y0.shape) and the rates (E, *y0.shape) at all but the last, from y0 on the CPU."""
        points, rates = y0.new_empty(len(self.times) + 1, *y0.shape), y0.new_empty(len(self.times), *y0.shape)
        points[0] = y0
        flat, wide = (x.view(len(x), -1).numpy() for x in (points, rates))
        each = zip(self.times.unbind(), self.earlier, points.unbind(), rates.unbind(), strict=False)
        for k, (s, (first, weights), point, rate) in enumerate(each):
            rate.copy_(field(s, point))
            new = np.matmul(weights.astype(wide.dtype), wide[first : first + len(weights)], out=flat[k + 1])
            new += flat[k]
        return points, rates

    @np.errstate(all="ignore")
    def back(self, jacobians: np.ndarray, gradients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The gradient by each rate, (E, K, M), and by the first point, (K, M).

        Arguments:
            jacobians: ∂ rate / ∂ state of M samples at the evaluations, (E, K, K, M).
            gradients: by the solve's states, (T, K, M).
        """
        count, size, _, samples = jacobians.shape
        total = np.zeros((count + 1, size, samples), gradients.dtype)  # by each point, and what is built on it
        for place, gradient in zip(self.states, gradients, strict=True):
            total[place] += gradient
        by_rate = np.zeros((count, size, samples), gradients.dtype)
        flat, wide = total.reshape(count + 1, -1), by_rate.reshape(count, -1)
        for k in reversed(range(count)):
            first, weights = self.later[k]
            np.matmul(weights.astype(flat.dtype), flat[first : first + len(weights)], out=wide[k])
            here, rate, jacobian = total[k], by_rate[k], jacobians[k]
            here += total[k + 1]
            for i in range(size):
                here += jacobian[i] * rate[i]
        return by_rate, total[0]


def _within(weights: np.ndarray) -> tuple[int, np.ndarray]:
    """Where the first weight is that is not zero but for rounding, and the weights from there to the last."""
    used = np.flatnonzero(np.abs(weights) > ROUNDING * np.abs(weights).max(initial=0.0))
    first, last = (int(used[0]), int(used[-1])) if len(used) else (0, -1)
    return first, weights[first : last + 1].copy()


@lru_cache(maxsize=64)  # a training's window grows: so many grids
def _scheme(method: str, substeps: int, t: tuple[float, ...], dtype: torch.dtype) -> Scheme | None:
    return Scheme.of(Solver(method, substeps=substeps), torch.tensor(t, dtype=dtype))


def takes_adjoint(solver: object, y0: Tensor, width: int) -> bool:
    """Whether a solver has explicit steps on the grid, and is better without a graph of them.

    Arguments:
        y0: states (…, B, K).
        width: how many numbers are made of a state for its rate.
    """
    return (
        isinstance(solver, Solver)
        and solver.method in EXPLICIT
        and solver.points_per_step == 1
        and y0.device.type == "cpu"
        and y0.dim() > 1
        and y0.shape[-1] <= LARGEST
        and width * y0.shape[:-1].numel() <= NUMBERS
    )


@dataclass(frozen=True)
class Part:
    """A part of dy/dt.

    Attributes:
        rate: at a time and states (…, B, *state), the shape of the states.
        components: of the state, R of them; its rate of all others is zero.
        linearised: for the same, of states that are vectors, the rates, whose gradient reaches what they depend on but
            the states, and ∂ rate / ∂ state (R, …, B, K) of the components, without a graph; None: by backpropagation.
    """

    rate: Callable[..., Tensor]
    components: Sequence[int]
    linearised: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]] | None = None


def sum_of(parts: Sequence[Part]) -> Callable[..., Tensor]:
    """dy/dt as a function of what its parts are functions of."""
    if len(parts) == 1:
        return parts[0].rate
    rates = [part.rate for part in parts]

    def field(*given: Tensor) -> Tensor:
        total = rates[0](*given)
        for rate in rates[1:]:
            total = total + rate(*given)
        return total

    return field


def solve_with_adjoint(
    solver: Solver, parts: Sequence[Part], repeated: Callable[[int], Sequence[Part]], y0: Tensor, t: Tensor
) -> Tensor:
    """States (T, …, B, K) at the times t (T,), the first being y0 (…, B, K), on the CPU; their gradient reaches y0 and
    whatever the rates depend on.

    A field that does not give the same rates again, as one with dropout, or takes one time only, is solved with a graph
    of its steps instead.

    Arguments:
        solver: with explicit steps on the grid.
        parts: of dy/dt at a time and states (…, B, K).
        repeated: the same parts, by how many states E of each sample they are given at once: at times (…, B·E) and
            states (…, B·E, K).
    """
    field, scheme = sum_of(parts), _scheme(solver.method, solver.substeps, tuple(t.tolist()), t.dtype)
    if scheme is None:
        return solver(field, y0, t)
    count = len(scheme.times)
    with torch.no_grad():
        points, rates = scheme.steps(field, y0.detach())
        visited = points[:-1].movedim(0, -2).flatten(-3, -2)
    times = scheme.times.to(y0.dtype).expand(*y0.shape[:-1], -1).flatten(-2)
    try:
        total, jacobians = _linearised(repeated(count), times, visited, count)
    except Exception:  # a field that takes one time only; what else is wrong with it shows below
        return solver(field, y0, t)
    if not _same(rates.movedim(0, -2).flatten(-3, -2), total.detach(), count):
        return solver(field, y0, t)
    states = points[list(scheme.states)]
    return _Adjoint.apply(total, y0, states, jacobians, scheme)  # type: ignore[no-any-return]


def _linearised(parts: Sequence[Part], times: Tensor, states: Tensor, count: int) -> tuple[Tensor, np.ndarray]:
    """Rates (…, B·E, K) at times and states, with a graph, and ∂ rate / ∂ state, (E, K, K, M)."""
    size = states.shape[-1]
    jacobians = states.new_zeros(count, size, size, states.numel() // (size * count))
    total: Tensor | None = None
    for part in parts:
        again, slopes = (part.linearised or partial(_by_backpropagation, part))(times, states)
        for k, slope in zip(part.components, slopes, strict=True):
            jacobians[:, k] += slope.reshape(-1, count, size).permute(1, 2, 0)
        total = again if total is None else total + again
    assert total is not None
    return total, jacobians.numpy()


def _by_backpropagation(part: Part, times: Tensor, states: Tensor) -> tuple[Tensor, Tensor]:
    """What :attr:`Part.linearised` gives, of any part."""
    states, slopes = states.detach().requires_grad_(), []
    with torch.enable_grad():
        rates = part.rate(times, states)
    for k in part.components:
        given = torch.zeros_like(rates)
        given[..., k] = 1.0
        slopes.append(_slope(rates, states, given))
    return rates, torch.stack(slopes)


def _slope(rates: Tensor, states: Tensor, given: Tensor) -> Tensor:
    if not rates.requires_grad:
        return torch.zeros_like(states)
    return torch.autograd.grad(rates, states, given, retain_graph=True, materialize_grads=True, allow_unused=True)[0]


def _same(first: Tensor, again: Tensor, count: int) -> bool:
    """Whether rates (…, B·E, K) are the same but for rounding, wherever they are finite."""
    if again.shape != first.shape:
        return False
    size = first.abs().unflatten(-2, (-1, count)).nan_to_num(0.0, 0.0, 0.0).amax((-2, -1), keepdim=True)
    near = (again - first).abs().unflatten(-2, (-1, count)) <= EQUAL * size + torch.finfo(first.dtype).tiny
    return bool((near | ~torch.isfinite(first).unflatten(-2, (-1, count))).all())


class _Adjoint(torch.autograd.Function):
    """States whose gradient becomes one of the rates at all visited states."""

    @staticmethod
    def forward(ctx: Any, again: Tensor, y0: Tensor, states: Tensor, jacobians: np.ndarray, scheme: Scheme) -> Tensor:
        ctx.jacobians, ctx.scheme, ctx.shape = jacobians, scheme, again.shape
        return states.view_as(states)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradients: Tensor) -> tuple[Tensor, Tensor, None, None, None]:
        size = gradients.shape[-1]
        given = gradients.reshape(len(gradients), -1, size).mT.contiguous().numpy()
        by_rate, by_start = ctx.scheme.back(ctx.jacobians, given)
        rates = torch.from_numpy(by_rate).permute(2, 0, 1).reshape(ctx.shape)
        return rates, torch.from_numpy(by_start).mT.reshape(gradients.shape[1:]), None, None, None
