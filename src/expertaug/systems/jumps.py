"""Where rates jump between states: a solver with a tolerance creeps through a jump, and may never come to its end."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.systems.base import System
from expertaug.systems.settings import EVENTS, FIXED

PATIENCE = 10_000  # evaluations of the rates in one solve before they are looked at: seconds
LINES, POINTS = 8, 33  # through the states, and points on each
HALVINGS = 30  # of the part of a line where rates change most: 1e-9 of it is left
STEEP = 1e-3  # of all changes along a line: what is left of a continuous one is far less
ROUNDING = 1e-6  # of the rates: changes along a line that are less in sum are rounding
STEADY = 1.5  # between half of the halvings and all of them a jump stays as it is; at a pole the change grows


@torch.no_grad()
def find_jump(rates: Callable[[Tensor], Tensor], y: Tensor) -> Tensor | None:
    """A state (*state) at which rates jump; None where none is found.

    Rates are followed along lines through the states; where they change most, the line is halved again and again. What
    a continuous function changes there vanishes with the length.

    Arguments:
        rates: of states (N, *state), all at one time and of the parameters of the N states.
        y: states (N, *state).
    """
    generator, each = torch.Generator().manual_seed(0), torch.arange(len(y))
    y = y.double()
    size = y.abs().flatten(1).amax(1).clamp_min(1e-3)

    def wide(x: Tensor) -> Tensor:
        return x.view(-1, *[1] * (y.dim() - 1))

    for _ in range(LINES):
        direction = wide(size) * torch.randn(y.shape, generator=generator, dtype=y.dtype)
        points = torch.stack([torch.lerp(y - direction, y + direction, k / (POINTS - 1)) for k in range(POINTS)])
        values = torch.stack([rates(p) for p in points])
        changes = torch.stack([_largest(b - a) for a, b in pairwise(values)]).nan_to_num(0.0, 0.0)
        part = changes.argmax(0)
        low, high, low_rate, high_rate = (x[part + k, each] for x in (points, values) for k in (0, 1))
        half_way = changes[part, each]
        for step in range(HALVINGS):
            middle = (low + high) / 2
            rate = rates(middle)
            first = wide(_largest(rate - low_rate) > _largest(high_rate - rate))
            low, high = torch.where(first, low, middle), torch.where(first, middle, high)
            low_rate, high_rate = torch.where(first, low_rate, rate), torch.where(first, rate, high_rate)
            if step == HALVINGS // 2:
                half_way = _largest(high_rate - low_rate)
        left = _largest(high_rate - low_rate)
        least = STEEP * torch.maximum(changes.sum(0), ROUNDING * _largest(high_rate))
        bad = (left > least) & (left < STEADY * half_way) & (left > half_way / STEADY)
        if bad.any():
            return high[bad.int().argmax()]
    return None


def _largest(difference: Tensor) -> Tensor:
    return difference.abs().flatten(1).amax(1)


def watch(system: System, rates: Callable[..., Tensor], what: str) -> Callable[..., Tensor]:
    """The same rates for one solve to a tolerance; where that takes long they are looked at once.

    Arguments:
        rates: of a time and states (N, *state), and of what a driven system is given besides.
        what: for the message.

    Raises:
        InputError: when it is called for the :data:`PATIENCE`-th time, and the rates jump near where the solver is.
    """
    if system.has_events or system.simulation.method in FIXED or len(system.state_shape) > 1:
        return rates
    calls = 0

    def counted(t: Tensor, y: Tensor, *more: Tensor) -> Tensor:
        nonlocal calls
        calls += 1
        if calls == PATIENCE:
            at = find_jump(lambda states: rates(t, states, *more), y)
            if at is not None:
                near = ", ".join(f"{p.name} = {v:.3g}" for p, v in zip(system.state, at.tolist(), strict=True))
                raise InputError(
                    what,
                    f"the rates jump near {near}, and {system.simulation.method} creeps through a jump",
                    "define event and jump where they do, with the side as an argument, or simulate on a fixed grid: "
                    f'simulation = Solver("{EVENTS}", substeps=20)',
                )
        return rates(t, y, *more)

    return counted
