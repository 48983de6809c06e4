"""Solvers for stiff systems, which torchdiffeq lacks: Rosenbrock steps with gradients, and scipy's implicit methods.

Both need the Jacobian of every sample's rate by its own state, (…, d, d) for states of d numbers; samples must not
depend on each other.
"""

from __future__ import annotations

from collections.abc import Callable
from math import prod
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from expertaug.errors import InputError, SolveError

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

Field = Callable[[Tensor, Tensor], Tensor]
SCIPY = {"radau": "Radau", "bdf": "BDF"}
LARGEST = 128  # numbers in a state: the Jacobian costs that many gradients
SINGLE = 1e-5  # least relative tolerance in single precision: below, rounding keeps Newton's iteration from converging


def rodas3(f: Field, y0: Tensor, t: Tensor, rank: int = 1) -> Tensor:
    """States (T, …, *state) at the times t (T,), one step from time to time.

    Rodas3 (Sandu et al. 1997, table 2): linearly implicit, of third order, L-stable and stiffly accurate.  It solves
    four linear systems of one matrix a step, no nonlinear one, and autograd goes through it.

    Arguments:
        f: dy/dt at a time and states (…, *state).
        y0: (…, *state).
        rank: axes of a state.

    Raises:
        InputError: a state has too many numbers for its Jacobian.
    """
    d = _size(y0, rank, "rodas3")
    shape, states = y0.shape, [y0]
    identity = torch.eye(d, dtype=y0.dtype, device=y0.device)
    for begin, h in zip(t[:-1], t.diff(), strict=True):
        y = states[-1]
        rate, jacobian, by_time = _derivatives(f, begin, y, rank)
        factors = torch.linalg.lu_factor_ex(identity * (2 / h) - jacobian)[:2]
        first = rate.reshape(-1, d)

        def stage(right: Tensor, share: float) -> Tensor:
            if share and by_time is not None:  # noqa: B023
                right = right + share * h * by_time.reshape(-1, d)  # noqa: B023
            return torch.linalg.lu_solve(*factors, right.unsqueeze(-1)).squeeze(-1)  # noqa: B023

        def at_end(y: Tensor) -> Tensor:
            return f(begin + h, y.view(shape)).reshape(-1, d)  # noqa: B023

        flat = y.reshape(-1, d)
        k1 = stage(first, 0.5)
        k2 = stage(first + 4 / h * k1, 1.5)
        k3 = stage(at_end(flat + 2 * k1) + (k1 - k2) / h, 0.0)
        middle = flat + 2 * k1 + k3
        k4 = stage(at_end(middle) + (k1 - k2 - 8 / 3 * k3) / h, 0.0)
        states.append((middle + k4).view(shape))
    return torch.stack(states)


def by_scipy(f: Field, y0: Tensor, t: Tensor, method: str, rtol: float, atol: float, rank: int = 1) -> Tensor:
    """States (T, …, *state) at the times t (T,) to a tolerance, by Radau IIA of order 5 or BDF; no gradients.

    All samples are one system whose Jacobian has a block a sample; arguments otherwise as :func:`rodas3`.

    Raises:
        InputError: gradients are wanted, or a state has too many numbers for its Jacobian.
        SolveError: the solver gave up.
    """
    from scipy.integrate import solve_ivp  # half a second that no other method needs
    from scipy.sparse import csc_matrix

    d = _size(y0, rank, method)
    if torch.is_grad_enabled() and (y0.requires_grad or f(t[0], y0).requires_grad):
        raise InputError("solver.method", f"{method} gives no gradients", "train with rodas3")
    values = y0.numel()
    rows = np.arange(values).reshape(-1, 1, d).repeat(d, axis=1).ravel()  # of each column of each block
    starts = np.arange(values + 1) * d

    def state(y: np.ndarray) -> Tensor:
        return torch.as_tensor(y).to(y0).view(y0.shape)

    def rate(s: float, y: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return f(t.new_tensor(s), state(y)).reshape(-1).double().cpu().numpy()

    def jacobian(s: float, y: np.ndarray) -> csc_matrix:
        blocks = _derivatives(f, t.new_tensor(s), state(y), rank)[1].detach()
        return csc_matrix((blocks.mT.reshape(-1).double().cpu().numpy(), rows, starts), shape=(values, values))

    times = t.double().cpu().numpy()
    if y0.dtype == torch.float32:
        rtol = max(rtol, SINGLE)
    start = y0.detach().reshape(-1).double().cpu().numpy()
    span = (times[0], times[-1])
    try:
        solution = solve_ivp(rate, span, start, SCIPY[method], times, rtol=rtol, atol=atol, jac=jacobian)
    except ValueError as error:  # scipy's word for rates that are not finite
        raise SolveError(f"{method} failed ({error})") from error
    if not solution.success:
        raise SolveError(f"{method} failed ({solution.message})")
    return torch.from_numpy(solution.y.T.copy()).to(y0).view(len(times), *y0.shape)


def _size(y0: Tensor, rank: int, method: str) -> int:
    d = prod(y0.shape[y0.dim() - rank :])
    if d > LARGEST:
        problem = f"{method} for states of {d} numbers"
        raise InputError("solver.method", problem, f"it takes at most {LARGEST}; lawson4 has a linear part exact")
    return d


def _derivatives(f: Field, t: Tensor, y: Tensor, rank: int) -> tuple[Tensor, Tensor, Tensor | None]:
    """Rate (…, *state), its Jacobian (N, d, d) by the N states, and its derivative by time, None where it has none."""
    wanted = torch.is_grad_enabled() and (y.requires_grad or f(t, y).requires_grad)
    with torch.enable_grad():
        y = y if wanted and y.requires_grad else y.detach().requires_grad_()
        s = t.detach().requires_grad_()
        rate = f(s, y)
        flat = rate.flatten(y.dim() - rank).flatten(0, -2)  # (N, d)
        if not rate.requires_grad:  # it depends on neither
            return rate, flat.new_zeros(*flat.shape, flat.shape[-1]), None
        rows = []
        for k in range(flat.shape[-1]):
            (row,) = torch.autograd.grad(
                flat[:, k].sum(), y, create_graph=wanted, retain_graph=True, materialize_grads=True
            )
            rows.append(row.flatten(y.dim() - rank).flatten(0, -2))
        # The derivative by time of every number in one backward pass of a backward pass.
        weight = torch.zeros_like(rate, requires_grad=True)
        (total,) = torch.autograd.grad(rate, s, weight, create_graph=True, allow_unused=True)
        by_time = None
        if total is not None and total.requires_grad:
            (by_time,) = torch.autograd.grad(total, weight, create_graph=wanted, allow_unused=True)
    if not wanted:
        rate, rows = rate.detach(), [row.detach() for row in rows]
        by_time = None if by_time is None else by_time.detach()
    return rate, torch.stack(rows, dim=-2), by_time
