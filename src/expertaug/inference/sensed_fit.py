"""A window's problem with constants of sensors among what is estimated: they are seen in how far what is measured
contradicts the equation."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.inference.least_squares import WindowFit
from expertaug.inference.levenberg_marquardt import LONGEST
from expertaug.models.fit_settings import CURVED, POWERS, Constant, SensorConstants
from expertaug.models.posterior import Estimates
from expertaug.models.sensors import Curve, Sensors
from expertaug.systems import System

logger = logging.getLogger(__name__)
WEAK = 0.25  # standard error of a sensor's constant, as a coordinate, which is told
TURNED = 0.01  # share of what was measured that may lie where a curve is flat


def constants_from(values: Tensor, errors: Tensor, groups: np.ndarray) -> list[Constant]:
    count, pairs = len(set(groups.tolist())), zip(values.tolist(), errors.tolist(), strict=True)
    return [Constant(value=value, std=error, groups=count) for value, error in pairs]


@dataclass(frozen=True)
class SensorCoordinates:
    """Constants of sensors that are estimated, without units: logarithms of scales, offsets in the component's spread,
    and by how much the curve departs from a straight line there.

    Attributes:
        sought: component and name of each.
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

    def _named(self, wanted: str) -> Tensor:
        return torch.tensor([name == wanted for _, name in self.sought], dtype=torch.bool)

    @property
    def _factors(self) -> Tensor:
        """Units of the coordinates that are no logarithms, (M,)."""
        powers = torch.tensor([POWERS[name] for _, name in self.sought], dtype=torch.float64)
        return self.units**powers

    def sensors(self, x: Tensor) -> Sensors:
        """Of coordinates (…, M)."""
        of_component = torch.nn.functional.one_hot(torch.tensor(self.places, dtype=torch.long), self.components).to(x)
        scale = (torch.where(self._named("scale"), x, 0.0) @ of_component).exp()

        def constants(name: str) -> Tensor:
            return torch.where(self._named(name), x * self._factors, 0.0) @ of_component

        straight = not {name for _, name in self.sought} & set(CURVED)
        curve = None if straight else Curve(constants("quadratic"), constants("cubic"))
        return Sensors(scale, constants("offset"), self.axes, curve)

    def coordinates(self, constants: Mapping[str, SensorConstants]) -> Tensor:
        """Of constants in their units, by component: (M,)."""
        values = torch.tensor([getattr(constants[c], name).value for c, name in self.sought], dtype=torch.float64)
        return torch.where(self._named("scale"), values.clamp_min(1e-30).log(), values / self._factors)

    def constants(self, x: Tensor, std: Tensor, groups: np.ndarray) -> dict[str, SensorConstants]:
        """The constants in their units, by component, of coordinates (M,) with their standard errors; what is hardly
        told is told.

        Arguments:
            groups: numbers of the groups of windows that they are from.
        """
        is_scale, factors = self._named("scale"), self._factors
        values, slopes = torch.where(is_scale, x.exp(), x * factors), torch.where(is_scale, x.exp(), factors)
        each: dict[str, dict[str, Constant]] = {}
        for (component, name), constant, weak in zip(
            self.sought, constants_from(values, std * slopes, groups), (std > WEAK).tolist(), strict=True
        ):
            each.setdefault(component, {})[name] = constant
            if weak:
                text = "sensors.%s.%s: %.3g (± %.2g): the windows hardly tell it; leave it out"
                logger.warning(text, component, name, constant.value, constant.std)
        return {component: SensorConstants.of(**constants) for component, constants in each.items()}

    def check_curves(self, x: Tensor, windows: Tensor) -> None:
        """Refuse a curve that turns back within what was measured: there the state is not known.

        Arguments:
            x: coordinates (M,).
            windows: what was measured, (T, 1, N, *state).

        Raises:
            InputError: of which sensor.
        """
        sensors = self.sensors(x)
        if sensors.curve is None:
            return
        low, high = sensors.curve.ends
        states, axis = sensors.state(windows), windows.dim() - self.axes
        for (component, name), place in zip(self.sought, self.places, strict=True):
            if name not in CURVED:
                continue
            column, (least, most) = states.select(axis, place), (float(low[place]), float(high[place]))
            beyond = ((column <= least) | (column >= most)).sum() / (~column.isnan()).sum().clamp_min(1)
            if float(beyond) > TURNED:
                nearest = min((end for end in (least, most) if np.isfinite(end)), key=abs)
                problem = f"the curve that was found turns back near {component} = {nearest:.3g}, which windows reach"
                raise InputError(f"refinement.sensors.{component}.{name}", problem, "leave it out")


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
