"""The observation model beside the state: each component as its sensor shows it, measured = scale · state + offset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.models.settings import SensorConstants
from expertaug.systems import System


@dataclass(frozen=True)
class Sensors:
    """Scales and offsets of a state's K components, of which one may be a field.

    Attributes:
        scale: measured per true change, > 0, (…, K).
        offset: what is measured where the state is 0, in the component's unit, (…, K).
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
        scale = [1.0 if one.scale is None else one.scale.value for one in each]
        offset = [0.0 if one.offset is None else one.offset.value for one in each]
        tensors = (torch.tensor(values, dtype=torch.float64) for values in (scale, offset))
        return cls(*tensors, len(system.state_shape))

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
        pairs = zip(measured.items(), self.scale.tolist(), self.offset.tolist(), strict=True)
        return {name: [(end - offset) / scale for end in ends] for (name, ends), scale, offset in pairs}

    def _wide(self, constants: Tensor, like: Tensor) -> Tensor:
        return constants.to(like).view(*constants.shape, *[1] * (self.axes - 1))


def check_components(system: System, names: Mapping[str, object]) -> None:
    """Refuse sensors of what is no component of the state.

    Raises:
        InputError: which one, and those that there are.
    """
    known = [p.name for p in system.state]
    for name in names:
        if name not in known:
            raise InputError(f"sensors.{name}", "is no component of the state", f"known: {', '.join(known)}")
