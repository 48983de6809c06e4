"""The observation model beside the state: each component as its sensor shows it, measured = scale · state + offset."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from expertaug.models.settings import SensorConstants
from expertaug.systems import System
from expertaug.wording import check_keys


@dataclass(frozen=True)
class Sensors:
    """Scales and offsets of a state's K components, of which one may be a field.

    Attributes:
        scale: measured per true change, > 0, (…, K); (S, 1, K) where each seed has its own.
        offset: what is measured where the state is 0, in the component's unit, likewise.
        axes: of a state: 1, or 3 of fields on a grid.
    """

    scale: Tensor
    offset: Tensor
    axes: int

    @classmethod
    def of(cls, system: System, constants: Mapping[str, SensorConstants]) -> Sensors:
        """Of what was estimated; a component that is not named is measured as it is.

        Raises:
            InputError: a name that is no component's.
        """
        check_components(system, constants)
        each = [constants.get(p.name) or SensorConstants() for p in system.state]
        scale = _stack([1.0 if sensor.scale is None else sensor.scale.held for sensor in each])
        offset = _stack([0.0 if sensor.offset is None else sensor.offset.held for sensor in each])
        return cls(scale, offset, len(system.state_shape))

    def measured(self, states: Tensor) -> Tensor:
        """States (…, *state) → what sensors show of them."""
        return self._wide(self.scale, states) * states + self._wide(self.offset, states)

    def state(self, measured: Tensor) -> Tensor:
        """What sensors show (…, *observed) → states, known inputs behind them as they are; NaN stays NaN."""
        axis = measured.dim() - self.axes
        shown, inputs = measured.tensor_split([self.scale.shape[-1]], dim=axis)
        states = (shown - self._wide(self.offset, shown)) / self._wide(self.scale, shown)
        return torch.cat((states, inputs), dim=axis) if inputs.shape[axis] else states

    def state_ranges(self, measured: Mapping[str, Sequence[float]]) -> dict[str, list[float]]:
        """Ranges by component, of all of them in the state's order, as sensors show them → of the state."""
        scales, offsets = (x.reshape(-1, x.shape[-1]).mean(0).tolist() for x in (self.scale, self.offset))
        pairs = zip(measured.items(), scales, offsets, strict=True)
        return {name: [(end - offset) / scale for end in ends] for (name, ends), scale, offset in pairs}

    def _wide(self, constants: Tensor, like: Tensor) -> Tensor:
        return constants.to(like).view(*constants.shape, *[1] * (self.axes - 1))


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
