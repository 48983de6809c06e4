"""Solving a system with its known inputs u(t) and its events; the system as an encoder sees it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.systems.base import System, constant_like
from expertaug.systems.solvers.events import Event
from expertaug.systems.solvers.linear_propagator import Propagator

SAMPLES = 8
# dy/dt at a time and states, and at inputs (…, U) where the system has some.
DrivenField = Callable[..., Tensor]


class Linear:
    """Inputs that are linear between the times at which they are known.

    Arguments:
        t: times in s, (T,), T ≥ 2.
        u: (T, …, B, U).
    """

    def __init__(self, t: Tensor, u: Tensor) -> None:
        self.t, self.u = t.cpu(), u

    def __call__(self, s: Tensor) -> Tensor:
        """u (…, B, U) at one time s, or at a time for each sample (…, B); a solver's step beyond the last time goes on
        straight."""
        t = self.t.to(s.device, non_blocking=True)
        k = (torch.searchsorted(t, s.detach().to(t).contiguous(), right=True) - 1).clamp(0, len(t) - 2)
        share = (s - t[k]) / (t[k + 1] - t[k])
        if s.dim() == 0:
            return torch.lerp(self.u[k], self.u[k + 1], share.to(self.u.device, non_blocking=True))
        index = k[None, ..., None].expand(1, *self.u.shape[1:])
        before, after = (self.u.gather(0, place)[0] for place in (index, index + 1))
        return torch.lerp(before, after, share.unsqueeze(-1))


def solve(
    system: System,
    field: DrivenField,
    y0: Tensor,
    t: Tensor,
    solver: Any,
    z_e: Tensor,
    u: Tensor | None = None,
    propagator: Propagator | None = None,
) -> Tensor:
    """States (T, …, *state) at the times t (T,), the first being y0.

    Arguments:
        field: (s, y) → dy/dt; of a system with known inputs (s, y, u); of one with events the side is last.
        z_e: parameters (…, P), of which an event may depend.
        solver: a :class:`~expertaug.systems.solvers.solver.Solver`, or what is called like one.
        u: inputs (T, …, U) at the times t; None for a system without.
        propagator: as of the solver.

    Raises:
        InputError: the system has inputs and none are given, or the other way round.
    """
    rank, event = len(system.state_shape), event_of(system, z_e)
    options = {} if event is None else {"event": event}
    check_given(system, u)
    if u is None:
        return solver(field, y0, t, propagator, rank, **options)
    u = u.to(y0.dtype)
    if not system.inputs:  # covariates alone, which do not change

        def constant(s: Tensor, y: Tensor, *side: Tensor) -> Tensor:
            return field(s, y, u[0], *side)

        return solver(constant, y0, t, propagator, rank, **options)
    if system.interpolation == "linear" and len(t) > 1:
        signal = Linear(t, u)

        def driven(s: Tensor, y: Tensor, *side: Tensor) -> Tensor:
            return field(s, y, signal(s), *side)

        return solver(driven, y0, t, propagator, rank, kinks=True, **options)
    states = [y0]
    for k in range(len(t) - 1):  # a solver does not step across a jump of the inputs

        def held(s: Tensor, y: Tensor, *side: Tensor, now: Tensor = u[k]) -> Tensor:
            return field(s, y, now, *side)

        states.append(solver(held, states[-1], t[k : k + 2], propagator, rank, **options)[-1])
    return torch.stack(states)


def event_of(system: System, z_e: Tensor) -> Event | None:
    """A system's event for trajectories of parameters z_e (…, P); None for a system without."""
    if not system.has_events:
        return None
    return Event(lambda y: system.event(y, z_e), lambda y: system.jump(y, z_e))


def further(system: System, y: Tensor, z_e: Tensor, u: Tensor | None = None) -> tuple[Tensor, ...]:
    """What expert and truth are given besides t, y and the parameters at single states: inputs and side, where the
    system has them."""
    side = (system.event(y, z_e).sign(),) if system.has_events else ()
    return side if u is None else (u, *side)


def check_given(system: System, u: Tensor | None, where: str = "u") -> None:
    """Whether a system's inputs are given, and none to a system without.

    Raises:
        InputError: they are missing, are not known to the system, or are of another number.
    """
    names = ", ".join(p.name for p in system.known)
    if u is None and names:
        problem = f"{type(system).__name__} has the known inputs {names}"
        raise InputError(where, "missing", f"{problem}: give u (…, {len(system.known)})")
    if u is not None and u.shape[-1] != len(system.known):
        problem = f"u has {u.shape[-1]} components"
        raise InputError(
            where, problem, f"{type(system).__name__} has {f'{len(system.known)}: {names}' if names else 'none'}"
        )


def check_trainable(system: System, where: str = "system") -> None:
    """Whether a loss of forecasts is a continuous function of the parameters, as gradients need it: what is observed
    must not jump at events.  With a jump the gradient lacks what moving the event past a data time changes.

    Raises:
        InputError: it jumps.
    """
    if not system.has_events:
        return
    generator = torch.Generator().manual_seed(0)
    y = torch.rand(SAMPLES, *system.state_shape, generator=generator, dtype=torch.float64)
    z_e = y.new_tensor([p.scale for p in system.expert_parameters]).expand(SAMPLES, -1)
    for _ in range(SAMPLES):  # Newton's steps onto the event
        at = y.detach().requires_grad_()
        value = system.event(at, z_e)
        (slope,) = torch.autograd.grad(value.sum(), at)
        y = (at - slope * (value / slope.square().sum(-1).clamp_min(1e-30)).unsqueeze(-1)).detach()
    before, after = system.observe(y), system.observe(system.jump(y, z_e))
    if not torch.allclose(before, after, rtol=0.0, atol=1e-3 * float(before.abs().max().clamp_min(1e-12))):
        problem = f"what {type(system).__name__} observes jumps at its events, where a loss has no gradient to train by"
        raise InputError(where, problem, "fit windows by least squares, or observe what does not jump")


def states_of(system: System, windows: Tensor) -> Tensor:
    """The states of windows that have both (:attr:`expertaug.windows.Windows.joined`)."""
    return windows.narrow(_axis(system), 0, len(system.state)) if system.known else windows


def inputs_of(system: System, windows: Tensor) -> Tensor | None:
    """The inputs (T, …, B, U) of such windows; None for a system without."""
    if not system.known:
        return None
    u = windows.narrow(_axis(system), len(system.state), len(system.known))
    return u[(..., *[0] * (len(system.state_shape) - 1))]


def _axis(system: System) -> int:
    return -len(system.state_shape)


class Observed(System):
    """A system as an encoder sees it: its inputs are further components of the state."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.state = (*system.state, *system.known)
        self.expert_parameters = system.expert_parameters

    @property
    def state_shape(self) -> tuple[int, ...]:
        return (len(self.state), *self.system.state_shape[1:])

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor) -> Tensor:
        raise NotImplementedError("what an encoder sees has no equation")

    def observe(self, y: Tensor) -> Tensor:
        return self._with_inputs(self.system.observe, y)

    def features(self, y: Tensor) -> Tensor:
        return self._with_inputs(self.system.features, y, [p.scale for p in self.system.known])

    def _with_inputs(
        self, of_states: Callable[[Tensor], Tensor], y: Tensor, scales: list[float] | None = None
    ) -> Tensor:
        size, axis = len(self.system.state), _axis(self)
        u = y.narrow(axis, size, len(self.system.known))
        if scales is not None:
            u = u / constant_like(u, scales, u.dtype).view(-1, *[1] * (-axis - 1))
        return torch.cat((of_states(y.narrow(axis, 0, size)), u), dim=axis)


def as_observed(system: System) -> System:
    """The system as an encoder sees it: itself, where it has no inputs."""
    return Observed(system) if system.known else system
