"""Adams-Bashforth steps on a grid: one evaluation a step, where Runge-Kutta's of fourth order take four."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from expertaug.systems.solvers.linear_propagator import Frame, Propagator, Propagators, lawson4_step

# Weights of the last points' rates, newest first, by their number; CORRECTED begin with the predicted point's rate
# (Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I, III.1).
PREDICTED = {
    2: (3 / 2, -1 / 2),
    3: (23 / 12, -16 / 12, 5 / 12),
    4: (55 / 24, -59 / 24, 37 / 24, -9 / 24),
    5: (1901 / 720, -2774 / 720, 2616 / 720, -1274 / 720, 251 / 720),
}
CORRECTED = {
    2: (5 / 12, 8 / 12, -1 / 12),
    3: (9 / 24, 19 / 24, -5 / 24, 1 / 24),
    4: (251 / 720, 646 / 720, -264 / 720, 106 / 720, -19 / 720),
}
EQUAL = 1e-3  # of a step's length: what rounded times may differ by


def adams_bashforth(
    f: Callable[[Tensor, Tensor], Tensor], y0: Tensor, t: Tensor, propagator: Propagator | None, order: int
) -> Tensor:
    """States (T, *y0.shape) at the times t (T,), on the CPU, the first being y0.

    It starts, and starts again where the steps' length changes, by Runge-Kutta steps, and goes on by predictors with a
    corrector of a higher order until there are enough rates: in the end the error is of the order asked for. With a
    linear part all are steps for exp(−t L) y, which has that part exact (Lawson 1967).

    Arguments:
        f: dy/dt, without the linear part.
        propagator: of the linear part; None where there is none.
        order: 4 or 5.
    """
    propagators, states, last = Propagators(propagator), [y0], float("nan")
    for begin, h in zip(t[:-1], t.diff().tolist(), strict=True):
        if not abs(h - last) <= EQUAL * abs(h):
            frame, last, here = Frame(propagators(h)), h, None
            rates: list[Tensor] = []  # in the frame, carried on to the present
        rate = f(begin, states[-1])
        rates = [frame.into(rate), *rates]
        if len(rates) < order - 2:
            states.append(lawson4_step(f, begin, h, states[-1], rate, propagators(h / 2)))
            rates = frame.carried(rates)
            continue
        here = frame.into(states[-1]) if here is None else here
        new, *rest = frame.carried([_move(here, rates, PREDICTED[len(rates)], h), *rates[: order - 1]])
        if len(rates) < order:
            ahead, *weights = CORRECTED[len(rates)]
            predicted = frame.into(f(begin + h, frame.back(new)))
            new = frame.carried([_move(here, rates, weights, h)])[0] + h * ahead * predicted
        here, rates = new, rest
        states.append(frame.back(here))
    return torch.stack(states)


def _move(y: Tensor, rates: Sequence[Tensor], weights: Sequence[float], h: float) -> Tensor:
    for rate, weight in zip(rates, weights, strict=True):
        y = torch.add(y, rate, alpha=h * weight)
    return y
