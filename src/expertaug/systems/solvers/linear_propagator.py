"""The propagator y → exp(h L) y of a linear part of dy/dt = L y + f(t, y), and Runge-Kutta steps that have it exact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

Map = Callable[[Tensor], Tensor]
# propagator(h): the map y → exp(h L) y, or None where there is no linear part.
Propagator = Callable[[float], Map | None]


@dataclass(frozen=True)
class DiagonalPropagator:
    """y → exp(h L) y of an L that is diagonal in some basis, as diffusion is in Fourier's.

    A plain map will do for :meth:`System.linear_flow`; of one that says its basis, ab4 and ab5 change the basis once a
    step instead of once for each earlier rate.

    Attributes:
        into: states → coefficients in the basis; linear.
        back: its inverse.
        factor: exp(h L) there, which coefficients are multiplied by.
    """

    into: Map
    back: Map
    factor: Tensor

    def __call__(self, y: Tensor) -> Tensor:
        return self.back(self.factor * self.into(y))


class Propagators:
    """Propagators by length of the step, each made once.

    Arguments:
        propagator: of the linear part; None where there is none.
    """

    def __init__(self, propagator: Propagator | None) -> None:
        self.propagator = propagator
        self.made: dict[str, Map] = {}

    def __call__(self, h: float) -> Map:
        """The propagator for h s: the identity where there is no linear part."""
        length = f"{h:.5g}"  # a grid's steps are equal but for rounding
        if length not in self.made:
            self.made[length] = (self.propagator(h) if self.propagator else None) or _same
        return self.made[length]


class Frame:
    """Where earlier rates are kept: in the basis of a linear part, or, of one that has none, as they are.

    Arguments:
        advance: y → exp(h L) y for one step.
    """

    def __init__(self, advance: Map) -> None:
        self.advance = advance
        diagonal = isinstance(advance, DiagonalPropagator)
        self.into, self.back = (advance.into, advance.back) if diagonal else (_same, _same)

    def carried(self, parts: Sequence[Tensor]) -> list[Tensor]:
        """Each part, in the frame, a step later."""
        if self.advance is _same:
            return list(parts)
        whole, advance = torch.stack(tuple(parts)), self.advance
        return list((advance.factor * whole if isinstance(advance, DiagonalPropagator) else advance(whole)).unbind(0))


def lawson4_step(
    f: Callable[[Tensor, Tensor], Tensor], begin: Tensor, h: float | Tensor, y: Tensor, k1: Tensor, half: Map
) -> Tensor:
    """A classical Runge-Kutta step for exp(−t L) y, written for y (Lawson 1967).

    Arguments:
        f: dy/dt without L y.
        begin, h: time and length of the step.
        y, k1: state, and f there.
        half: y → exp(h/2 L) y.
    """
    y_half, k1_half = half(torch.stack((y, k1))).unbind(0)
    k2 = f(begin + h / 2, y_half + h / 2 * k1_half)
    k3 = f(begin + h / 2, y_half + h / 2 * k2)
    end, sum_half = half(torch.stack((y_half + h * k3, y_half + h / 6 * k1_half + h / 3 * (k2 + k3)))).unbind(0)
    return sum_half + h / 6 * f(begin + h, end)


def _same(y: Tensor) -> Tensor:
    return y
