"""Adams-Bashforth steps on a grid: one evaluation a step, where Runge-Kutta's of fourth order take four."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from expertaug.systems.flows import Flow, Flows, Frame, lawson4_step

# Of the last points' rates, newest first (Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I, III.1).
WEIGHTS = {
    "ab4": (55 / 24, -59 / 24, 37 / 24, -9 / 24),
    "ab5": (1901 / 720, -2774 / 720, 2616 / 720, -1274 / 720, 251 / 720),
}
EQUAL = 1e-3  # of a step's length: what rounded times may differ by


def adams_bashforth(
    f: Callable[[Tensor, Tensor], Tensor], y0: Tensor, t: Tensor, flow: Flow | None, method: str
) -> Tensor:
    """States (T, *y0.shape) at the times t (T,), on the CPU, the first being y0.

    The first steps, and those after a change of the steps' length, are Runge-Kutta's. With a linear part all are steps
    for exp(−t L) y, which has that part exact.

    Arguments:
        f: dy/dt, without the linear part.
        flow: of the linear part; None where there is none.
        method: ab4 or ab5, by order.
    """
    weights, flows = WEIGHTS[method], Flows(flow)
    states, last = [y0], float("nan")
    rates: list[Tensor] = []  # in the frame, carried on to the present
    here = None  # the present state in the frame
    for begin, h in zip(t[:-1], t.diff().tolist(), strict=True):
        if not abs(h - last) <= EQUAL * abs(h):
            frame, rates, here, last = Frame(flows(h)), [], None, h
        y = states[-1]
        rate = f(begin, y)
        rates = [frame.into(rate), *rates]
        if len(rates) < len(weights):
            states.append(lawson4_step(f, begin, h, y, rate, flows(h / 2)))
            rates = frame.carried(rates)
            continue
        here = frame.into(y) if here is None else here
        for weight, each in zip(weights, rates, strict=True):
            here = torch.add(here, each, alpha=h * weight)
        here, *rates = frame.carried([here, *rates[:-1]])
        states.append(frame.back(here))
    return torch.stack(states)
