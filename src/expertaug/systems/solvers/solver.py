"""Solving dy/dt = f(t, y): on the data's own grid, or to a tolerance; torchdiffeq where it has the method."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import torch
from pydantic import ValidationError
from torch import Tensor

from expertaug.errors import InputError, SolveError
from expertaug.settings import complaints
from expertaug.systems.settings import ADAMS, EVENTS, FIXED, SPLITTING, SolverSettings
from expertaug.systems.solvers.adams import adams_bashforth
from expertaug.systems.solvers.events import Event, step_through
from expertaug.systems.solvers.implicit import SCIPY, by_scipy, rodas3
from expertaug.systems.solvers.linear_propagator import Propagator, Propagators, lawson4_step
from expertaug.systems.solvers.odeint import odeint, on_grid

MOST_STEPS = 50_000  # from one time to the next: what needs more would hardly end


class Solver(SolverSettings):
    """How to solve.

    lawson4 is the fourth-order Runge-Kutta method that has the linear part of dy/dt = L y + f(t, y) exact (Lawson
    1967), and rk4 where there is none. ab4 and ab5 have it exact as well; where f bends or jumps at the times, as
    measured inputs make it, they take lawson4's steps. The tolerances are unused on a fixed grid, the substeps by
    adaptive methods.
    """

    def __init__(self, *values: Any, **settings: Any) -> None:
        """Settings of :class:`~expertaug.systems.settings.SolverSettings` by name, or in their order.

        Raises:
            InputError: one of them cannot be used.
        """
        settings |= dict(zip(type(self).model_fields, values, strict=False))
        try:
            super().__init__(**settings)
        except ValidationError as error:
            raise complaints(error, SolverSettings, self.WHERE)[0] from None

    @classmethod
    def from_mapping(cls, settings: Mapping[str, object] | Solver | None, where: str | None = None) -> Solver:
        """Build from a config slice.

        Raises:
            InputError: a key is unknown or a value cannot be used.
        """
        return settings if isinstance(settings, Solver) else cls(**(settings or {}))

    @property
    def splits(self) -> bool:
        """Whether the method wants the linear part as a propagator, and f without it."""
        return self.method in SPLITTING

    def __call__(
        self,
        f: Callable[..., Tensor],
        y0: Tensor,
        t: Tensor,
        propagator: Propagator | None = None,
        rank: int = 1,
        kinks: bool = False,
        event: Event | None = None,
        most_steps: int | None = None,
    ) -> Tensor:
        """States (T, *y0.shape) at the times t (T,), the first being y0.

        Arguments:
            f: dy/dt at a time, a single number that may lie on the CPU, and states (…, *state).
            t: on the CPU, or wherever y0 lies: steps on a fixed grid then wait for it once.
            propagator: of the part that f lacks, where the method wants one (:attr:`splits`).
            rank: axes of a state, which implicit methods need to know.
            kinks: whether f bends at the times t: an adaptive method then ends a step there.
            event: where trajectories jump; f then has the side as third argument (:mod:`.events`).
            most_steps: that dopri5 and dopri8 take from one time to the next before they give up; None:
                :data:`MOST_STEPS`.

        Raises:
            InputError: the method cannot stop at events.
            SolveError: an adaptive method gave up.
        """
        if event is not None and self.method != EVENTS:
            raise InputError("solver.method", f"{self.method} steps over events", f"give {EVENTS}, with substeps")
        if self.method in FIXED and self.points_per_step > 1 and not kinks:
            return self._over_points(f, y0, t, propagator, rank, event)
        if self.method in FIXED:
            grid = t
            if self.substeps > 1:
                share = torch.arange(self.substeps).to(t) / self.substeps
                grid = torch.cat(((t[:-1, None] + t.diff()[:, None] * share).flatten(), t[-1:]))
            if event is not None:
                return step_through(f, y0, grid.to(y0.device, non_blocking=True), event)[:: self.substeps]
            if self.method == "rodas3":
                return rodas3(f, y0, grid.to(y0.device, non_blocking=True), rank)[:: self.substeps]
            if self.method == "lawson4" or (self.splits and kinks):
                return _lawson4(f, y0, grid.cpu(), propagator)[:: self.substeps]
            if self.splits:
                return adams_bashforth(f, y0, grid.cpu(), propagator, ADAMS[self.method])[:: self.substeps]
            return on_grid(f, y0, grid, self.method)[:: self.substeps]
        if self.method in SCIPY:
            return by_scipy(f, y0, t, self.method, self.rtol, self.atol, rank)
        try:
            t = t.to(y0.device, non_blocking=True)
            options: dict[str, Any] = {"step_t": t[1:-1]} if kinks and len(t) > 2 else {}
            options["max_num_steps"] = MOST_STEPS if most_steps is None else most_steps
            return odeint(  # type: ignore[return-value]
                f, y0, t, method=self.method, rtol=self.rtol, atol=self.atol, options=options
            )
        except AssertionError as error:  # torchdiffeq's word for a step that underflowed, and for too many
            raise SolveError(f"{self.method} failed ({error})") from error

    def _over_points(
        self,
        f: Callable[..., Tensor],
        y0: Tensor,
        t: Tensor,
        propagator: Propagator | None,
        rank: int,
        event: Event | None,
    ) -> Tensor:
        """States at the times t by steps over several of them, and cubics through the steps' ends with their slopes.

        Raises:
            InputError: there are events, or a part that is exact, which f lacks.
        """
        if event is not None or propagator is not None:
            what = "events, which lie between points" if event is not None else "a linear part that is solved exactly"
            raise InputError("solver.points_per_step", f"a system with {what}", "leave it out")
        each, last = self.points_per_step, len(t) - 1
        ends = torch.tensor([*range(0, last, each), last], device=t.device)
        single = self.model_copy(update={"points_per_step": 1})
        states = single(f, y0, t[ends], None, rank)
        if last == 0:
            return states[:1]
        slopes = torch.stack([f(s, y) for s, y in zip(t[ends], states, strict=True)])
        begin = (torch.arange(last + 1, device=t.device) // each).clamp(max=len(ends) - 2)
        width = t[ends].diff()[begin]
        share, width = (values.to(y0).view(-1, *[1] * y0.dim()) for values in ((t - t[ends][begin]) / width, width))
        begin = begin.to(y0.device)
        rest = 1 - share
        within = rest * (states[begin] * (1 + 2 * share) + slopes[begin] * width * share)
        beyond = share * (states[begin + 1] * (1 + 2 * rest) - slopes[begin + 1] * width * rest)
        return rest * within + share * beyond


def _lawson4(f: Callable[[Tensor, Tensor], Tensor], y0: Tensor, t: Tensor, propagator: Propagator | None) -> Tensor:
    states, propagators = [y0], Propagators(propagator)
    for begin, h in zip(t[:-1], t.diff(), strict=True):
        y = states[-1]
        states.append(lawson4_step(f, begin, h, y, f(begin, y), propagators(float(h) / 2)))
    return torch.stack(states)


def check_finite(y: Tensor, z_e: Tensor, what: str) -> None:
    """Name the first trajectory that is not finite.

    Arguments:
        y: (T, …, *state) with as many axes between as z_e has before its last.
        z_e: (…, P).
        what: system, method or seed, for the message.

    Raises:
        SolveError: a value is NaN or infinite; the message names the sample and its parameters.
    """
    if torch.isfinite(y).all():
        return
    lead = z_e.dim() - 1
    bad = ~torch.isfinite(y).movedim(0, -1).flatten(lead).all(-1)
    index = tuple(bad.nonzero()[0].tolist())
    values = ", ".join(f"{v:.4g}" for v in z_e[index].tolist())
    raise SolveError(
        f"{what}: {int(bad.sum())} trajectories are not finite, the first at index {index} with parameters ({values}); "
        "narrow the parameter range or lower solver.rtol"
    )
