"""The observation model beside the state: each component y as its sensor shows it.

Measured is offset + scale · (y + quadratic · y² + cubic · y³): a straight sensor has the first two alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from expertaug.models.fit_settings import SensorConstants
from expertaug.systems import System
from expertaug.wording import check_keys

FLATTEST = 0.1  # slope of a curve, beside that at 0, to which it is inverted
STEPS = 20  # of Newton's method


@dataclass(frozen=True)
class Curve:
    """How a sensor departs from a straight line, (…, K) each: y + quadratic · y² + cubic · y³."""

    quadratic: Tensor
    cubic: Tensor

    def of(self, y: Tensor) -> Tensor:
        """States (…, K) → what a sensor of scale 1 shows."""
        return y * (1 + y * (self.quadratic + self.cubic * y))

    def inverse(self, shown: Tensor) -> Tensor:
        """What is shown (…, K) → states, between the places around 0 where the curve becomes too flat to tell them."""
        low, high = self.ends
        y = torch.minimum(torch.maximum(shown, low), high)
        for _ in range(STEPS):
            slope = 1 + y * (2 * self.quadratic + 3 * self.cubic * y)
            y = torch.minimum(torch.maximum(y - (self.of(y) - shown) / slope, low), high)
        return torch.where(shown.isnan(), shown, y)

    @property
    def ends(self) -> tuple[Tensor, Tensor]:
        """States (…, K) below and above 0 where the slope has fallen to :data:`FLATTEST`; infinite where it does not.

        In 1 / y the condition is quadratic, with a coefficient that is never 0.
        """
        steep, half = 1 - FLATTEST, self.quadratic
        discriminant = half.square() - 3 * self.cubic * steep
        root = discriminant.clamp_min(0).sqrt()
        never = discriminant < 0
        below = torch.where(never, 0.0, (-half - root) / steep).clamp_max(0)
        above = torch.where(never, 0.0, (-half + root) / steep).clamp_min(0)
        return torch.where(below < 0, 1 / below, -torch.inf), torch.where(above > 0, 1 / above, torch.inf)


@dataclass(frozen=True)
class Sensors:
    """Constants of the sensors of a state's K components, of which one may be a field.

    Attributes:
        scale: measured per true change near 0, > 0, (…, K); (S, 1, K) where each seed has its own.
        offset: what is measured where the state is 0, in the component's unit, likewise.
        axes: of a state: 1, or 3 of fields on a grid.
        curve: of sensors that are not straight, likewise.
    """

    scale: Tensor
    offset: Tensor
    axes: int
    curve: Curve | None = None

    @classmethod
    def of(cls, system: System, constants: Mapping[str, SensorConstants]) -> Sensors:
        """Of what was estimated; a component that is not named is measured as it is.

        Raises:
            InputError: a name that is no component's.
        """
        check_components(system, constants)
        each = [constants.get(p.name) or SensorConstants() for p in system.state]

        def stacked(name: str, otherwise: float) -> Tensor:
            known = [getattr(sensor, name) for sensor in each]
            return _stack([otherwise if constant is None else constant.held for constant in known])

        straight = all(sensor.quadratic is None and sensor.cubic is None for sensor in each)
        curve = None if straight else Curve(stacked("quadratic", 0.0), stacked("cubic", 0.0))
        return cls(stacked("scale", 1.0), stacked("offset", 0.0), len(system.state_shape), curve)

    def measured(self, states: Tensor) -> Tensor:
        """States (…, *state) → what sensors show of them."""
        shown = states if self.curve is None else self._wide_curve(self.curve, states).of(states)
        return self._wide(self.scale, states) * shown + self._wide(self.offset, states)

    def state(self, measured: Tensor) -> Tensor:
        """What sensors show (…, *observed) → states, known inputs behind them as they are; NaN stays NaN."""
        axis = measured.dim() - self.axes
        shown, inputs = measured.tensor_split([self.scale.shape[-1]], dim=axis)
        states = (shown - self._wide(self.offset, shown)) / self._wide(self.scale, shown)
        if self.curve is not None:
            states = self._wide_curve(self.curve, states).inverse(states)
        return torch.cat((states, inputs), dim=axis) if inputs.shape[axis] else states

    def state_ranges(self, measured: Mapping[str, Sequence[float]]) -> dict[str, list[float]]:
        """Ranges by component, of all of them in the state's order, as sensors show them → of the state."""

        def typical(constants: Tensor) -> Tensor:
            return constants.reshape(-1, constants.shape[-1]).mean(0).double()

        curve = None if self.curve is None else Curve(typical(self.curve.quadratic), typical(self.curve.cubic))
        middle = replace(self, scale=typical(self.scale), offset=typical(self.offset), axes=1, curve=curve)
        ends = middle.state(torch.tensor(list(measured.values()), dtype=torch.float64).mT)
        return dict(zip(measured, ends.mT.tolist(), strict=True))

    def _wide(self, constants: Tensor, like: Tensor) -> Tensor:
        return constants.to(like).view(*constants.shape, *[1] * (self.axes - 1))

    def _wide_curve(self, curve: Curve, like: Tensor) -> Curve:
        return Curve(self._wide(curve.quadratic, like), self._wide(curve.cubic, like))


def _stack(each: Sequence[float | Sequence[float]]) -> Tensor:
    """Constants of K components: (K,), or (S, 1, K) where seeds have their own."""
    values = torch.stack(torch.broadcast_tensors(*(torch.tensor(x, dtype=torch.float64) for x in each)), dim=-1)
    return values.unsqueeze(1) if values.dim() > 1 else values


def check_components(system: System, names: Iterable[str]) -> None:
    """Refuse sensors of what is no component of the state.

    Raises:
        InputError: which one, and those that there are.
    """
    check_keys(names, [p.name for p in system.state], "sensors", "component of the state")
