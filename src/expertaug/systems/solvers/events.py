"""Events within a step: where a trajectory jumps (a ball that bounces) or its law changes (friction at rest).

torchdiffeq's ``odeint_event`` stops one trajectory at its event; here every sample of a batch has its own.  A system's
``event`` is a number that changes its sign there.  Within a step the law is that of the side on which it begins: the
step is smooth, its end tells whether the event was crossed, and where it was the time of the crossing is found, the
state there is changed by the system's ``jump``, and the rest of the step goes on from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

MOST = 8  # events of one sample in a step; what comes to rest by ever smaller jumps stays at the last of them
HALVINGS = 24
NEAR = 0.1  # of a step: a crossing that Newton's step would move further touches the event rather than crosses it

# dy/dt at a time (one, or one a sample), states (…, d) and the side (…): −1, 1, or 0 for what stays on the event.
SidedField = Callable[[Tensor, Tensor, Tensor], Tensor]


@dataclass(frozen=True)
class Event:
    """The event of trajectories of given parameters.

    Attributes:
        value: states (…, d) → (…), of another sign on either side.
        jump: states at the event → those after it, on the event or beyond.
    """

    value: Callable[[Tensor], Tensor]
    jump: Callable[[Tensor], Tensor]


def step_through(f: SidedField, y0: Tensor, t: Tensor, event: Event) -> Tensor:
    """States (T, …, d) at the times t (T,), by a classical Runge–Kutta step from time to time.

    Gradients go through the time of an event: a step of Newton's method, whose slope is held, has them.  They are those
    of the number of events that there are: they do not know that a change may add one.
    """
    states = [y0]
    for begin, h in zip(t[:-1], t.diff(), strict=True):
        states.append(_step(f, states[-1], begin, h, event))
    return torch.stack(states)


def _step(f: SidedField, y: Tensor, s: Tensor, left: Tensor, event: Event) -> Tensor:
    """States after ``left`` s, which is one number or (…)."""
    for _ in range(MOST):
        side = _side(f, y, s, event)
        end = _runge_kutta(f, y, s, left, side)
        hit = side * event.value(end) < 0
        if not hit.any():
            return end
        s, left = s.expand(hit.shape), left.expand(hit.shape)
        share = torch.where(hit, _crossing(f, y, s, left, side, end, hit, event), 0.0)
        after = event.jump(_runge_kutta(f, y, s, share * left, side))
        y = torch.where(hit.unsqueeze(-1), after, end)
        s, left = s + torch.where(hit, share, 1.0) * left, torch.where(hit, (1 - share) * left, 0.0)
    return y


def _side(f: SidedField, y: Tensor, s: Tensor, event: Event) -> Tensor:
    """Sign of the event (…); on the event the side to which the law of that side leads, 0 where neither does (Filippov
    1988)."""
    with torch.no_grad():
        side = event.value(y).sign()
        if (side != 0).all():
            return side
        up, down = torch.ones_like(side), -torch.ones_like(side)
        leaves_up, leaves_down = (sign * _slope(f(s, y, sign), y, event) > 0 for sign in (up, down))
        left = torch.where(leaves_up, up, torch.where(leaves_down, down, side))
        return torch.where(side == 0, left, side)


def _crossing(
    f: SidedField, y: Tensor, s: Tensor, left: Tensor, side: Tensor, end: Tensor, hit: Tensor, event: Event
) -> Tensor:
    """Share (…) of a step after which the event is crossed, where it is: by halving on the step's cubic, then twice by
    Newton's method on the step itself."""
    with torch.no_grad():
        first, last = (left.unsqueeze(-1) * f(*at, side) for at in ((s, y), (s + left, end)))
        low, high = torch.zeros_like(left), torch.ones_like(left)
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            x = middle.unsqueeze(-1)
            between = y + x * first + x**2 * (3 * (end - y) - 2 * first - last) + x**3 * (2 * (y - end) + first + last)
            beyond = side * event.value(between) < 0
            low, high = torch.where(beyond, low, middle), torch.where(beyond, middle, high)
        share = (high - _newton(f, y, s, left, high, side, hit, event)).clamp(0, 1)
    return share - _newton(f, y, s, left, share, side, hit, event)


def _newton(
    f: SidedField, y: Tensor, s: Tensor, left: Tensor, share: Tensor, side: Tensor, hit: Tensor, event: Event
) -> Tensor:
    """By how much (…) of the step the crossing is nearer than ``share``; the slope carries no gradient."""
    there = _runge_kutta(f, y, s, share * left, side)
    with torch.no_grad():
        slope = left * _slope(f(s + share * left, there, side), there, event)
        good = hit & (event.value(there).abs() < NEAR * slope.abs())
    return torch.where(good, event.value(there), 0.0) / torch.where(good, slope, 1.0)


def _slope(rate: Tensor, y: Tensor, event: Event) -> Tensor:
    """How fast (…) the event's value changes at states and rates (…, d)."""
    with torch.enable_grad():
        at = y.detach().requires_grad_()
        (by_state,) = torch.autograd.grad(event.value(at).sum(), at)
    return (by_state * rate.detach()).sum(-1)


def _runge_kutta(f: SidedField, y: Tensor, s: Tensor, h: Tensor, side: Tensor) -> Tensor:
    """The classical fourth-order step of h s, one number or (…)."""
    wide = h.unsqueeze(-1) if h.dim() else h
    k1 = f(s, y, side)
    k2 = f(s + h / 2, y + wide / 2 * k1, side)
    k3 = f(s + h / 2, y + wide / 2 * k2, side)
    return y + wide / 6 * (k1 + 2 * (k2 + k3) + f(s + h, y + wide * k3, side))
