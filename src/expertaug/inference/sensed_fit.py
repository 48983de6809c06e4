"""A window's problem with constants of sensors among what is estimated: they are seen in how far what is measured
contradicts the equation."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from expertaug.inference.least_squares import WindowFit
from expertaug.inference.levenberg_marquardt import LONGEST
from expertaug.models.posterior import Estimates
from expertaug.models.sensors import Sensors
from expertaug.models.settings import Constant, SensorConstants
from expertaug.systems import System

logger = logging.getLogger(__name__)
WEAK = 0.25  # standard error of a sensor's constant, of a scale or of the component's spread, which is told


def constants_from(values: Tensor, errors: Tensor, groups: np.ndarray) -> list[Constant]:
    count, pairs = len(set(groups.tolist())), zip(values.tolist(), errors.tolist(), strict=True)
    return [Constant(value=value, std=error, groups=count) for value, error in pairs]


@dataclass(frozen=True)
class SensorCoordinates:
    """Constants of sensors that are estimated: logarithms of scales, offsets in units of the component's spread.

    Attributes:
        sought: component and name, scale or offset, of each.
        places: of their components in the state of K.
        units: standard deviation of each one's component over the windows, in its unit.
        components: K.
        axes: of a state.
    """

    sought: Sequence[tuple[str, str]]
    places: Sequence[int]
    units: Tensor
    components: int
    axes: int

    @classmethod
    def of(cls, system: System, sought: Sequence[tuple[str, str]], windows: Tensor) -> SensorCoordinates:
        """Of a system, and what was measured of it, (T, 1, N, *state)."""
        names = [p.name for p in system.state]
        places, axis = [names.index(component) for component, _ in sought], windows.dim() - len(system.state_shape)
        columns = [windows.select(axis, place) for place in places]
        spreads = [float(column[~column.isnan()].std()) if (~column.isnan()).sum() > 1 else 1.0 for column in columns]
        units = torch.tensor([spread or 1.0 for spread in spreads], dtype=torch.float64)
        return cls(sought, places, units, len(names), len(system.state_shape))

    def sensors(self, x: Tensor) -> Sensors:
        """Of coordinates (…, M)."""
        of_component = torch.nn.functional.one_hot(torch.tensor(self.places, dtype=torch.long), self.components).to(x)
        is_scale = torch.tensor([name == "scale" for _, name in self.sought])
        scale = (torch.where(is_scale, x, 0.0) @ of_component).exp()
        return Sensors(scale, torch.where(is_scale, 0.0, x * self.units) @ of_component, self.axes)

    def coordinates(self, constants: Mapping[str, SensorConstants]) -> Tensor:
        """Of constants in their units, by component: (M,)."""
        values = torch.tensor([getattr(constants[c], name).value for c, name in self.sought], dtype=torch.float64)
        is_scale = torch.tensor([name == "scale" for _, name in self.sought], dtype=torch.bool)
        return torch.where(is_scale, values.clamp_min(1e-30).log(), values / self.units)

    def constants(self, x: Tensor, std: Tensor, groups: np.ndarray) -> dict[str, SensorConstants]:
        """The constants in their units, by component, of coordinates (M,) with their standard errors; what is hardly
        told is told.

        Arguments:
            groups: numbers of the groups of windows that they are from.
        """
        is_scale = torch.tensor([name == "scale" for _, name in self.sought])
        values, slopes = torch.where(is_scale, x.exp(), x * self.units), torch.where(is_scale, x.exp(), self.units)
        each: dict[str, dict[str, Constant]] = {}
        for (component, name), constant, weak in zip(
            self.sought, constants_from(values, std * slopes, groups), (std > WEAK).tolist(), strict=True
        ):
            each.setdefault(component, {})[name] = constant
            if weak:
                text = "sensors.%s.%s: %.3g (± %.2g): the windows hardly tell it; leave it out"
                logger.warning(text, component, name, constant.value, constant.std)
        return {component: SensorConstants.of(**constants) for component, constants in each.items()}


class SensedFit:
    """A window's problem with the constants of sensors as further coordinates, after those of the fit.

    Arguments:
        fit: of states that are measured as they are.
        sensors: what is estimated of sensors.
    """

    def __init__(self, fit: WindowFit, sensors: SensorCoordinates) -> None:
        self.fit, self.sensors = fit, sensors
        limits = torch.full((len(sensors.sought),), LONGEST, dtype=torch.float64)
        self.longest = torch.cat((fit.longest, limits))

    def start(self, windows: Tensor) -> Tensor:
        """Coordinates (1, N, K) of fits of each window as if sensors showed the state."""
        x = self.fit.coordinates(self.fit(windows), self.fit.first(windows))
        return torch.cat((x, x.new_zeros(*x.shape[:-1], len(self.sensors.sought))), dim=-1)

    def carried(self, x: Tensor, windows: Tensor, other: SensedFit) -> Tensor:
        """Coordinates (1, N, K) of the same estimates in another fit, of another noise or of longer windows."""
        own, constants = x.tensor_split([sum(self.fit.sizes)], dim=-1)
        seen = self.sensors.sensors(constants).state(windows) if self.sensors.sought else windows
        z_e, z_a, y0 = self.fit.parts(own, self.fit.first(seen))
        own = other.fit.coordinates(Estimates(y0, z_e, z_a), other.fit.first(seen))
        return torch.cat((own, constants), dim=-1)

    def left(self, x: Tensor, windows: Tensor) -> dict[str, float]:
        """Root mean square of what is left of each component at coordinates (1, N, K), with so many degrees of freedom
        as windows have parameters of their own."""
        states = [p.name for p in self.fit.system.state]
        residuals = self.residuals(x.unsqueeze(0), windows)[0]
        data = residuals[..., : residuals.shape[-1] - self.fit.pulls].unflatten(-1, (-1, len(states)))
        count = data.numel() / len(states) - self.fit.missing(windows).sum() / len(states)
        free = 1 - (x.shape[1] * sum(self.fit.sizes) / len(states)) / float(count)
        squares = data.square().sum((0, 1, 2)) / count / max(free, 0.1)
        noise = torch.as_tensor(self.fit.observed_noise, dtype=torch.float64).expand(len(states))
        return dict(zip(states, (squares.sqrt() * noise).tolist(), strict=True))

    def residuals(self, x: Tensor, windows: Tensor) -> Tensor:
        """As :meth:`WindowProblem.residuals`, in units of what is measured."""
        if not self.sensors.sought:
            return self.fit.residuals(x, windows)
        copies, seeds, count = x.shape[:3]
        wide = x.movedim(0, 1).flatten(1, 2)
        observed = windows.repeat(1, 1, copies, *[1] * (windows.dim() - 3))
        own, constants = wide.tensor_split([sum(self.fit.sizes)], dim=-1)
        sensors = self.sensors.sensors(constants)
        states = sensors.measured(self.fit.states(own, sensors.state(observed)))
        data = self.fit.differences(states, observed)
        return torch.cat((data, self.fit.pull(own)), -1).view(seeds, copies, count, -1).movedim(1, 0)
