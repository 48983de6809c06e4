"""What all windows share while F_a is learned: held at a value, and fitted anew to the training windows between blocks
of steps.

Block coordinate descent on one sum of squares: F_a and each window's own parameters move while the constants are held;
then the constants and the windows' own are minimised together with F_a as it is (:mod:`expertaug.inference.shared`).
Each seed has constants of its own, since each has an F_a of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from expertaug.inference.coordinates import LogCoordinates
from expertaug.inference.joint_fit import minimise_together
from expertaug.inference.least_squares import WindowFit
from expertaug.inference.sensed_fit import SensedFit, SensorCoordinates
from expertaug.models.decoder import Decoder
from expertaug.models.fit_settings import Refinement
from expertaug.models.sensors import Sensors
from expertaug.models.stacking import select
from expertaug.systems import System

STEPS = 6  # of all windows together, at most: F_a moves on afterwards
TOLERANCE = 1e-5


@dataclass
class HeldConstants:
    """Constants of S seeds.

    Attributes:
        problem: of a decoder of one seed, where every parameter is a window's own.
        parameters: places of the shared ones among the system's expert parameters.
        sensors: coordinates of the constants of sensors.
        values: coordinates (S, M) of both, parameters first.
    """

    problem: Callable[[Decoder], WindowFit]
    parameters: Sequence[int]
    sensors: SensorCoordinates
    values: Tensor

    @classmethod
    def of(
        cls,
        system: System,
        problem: Callable[[Decoder], WindowFit],
        first: Refinement,
        windows: Tensor,
        seeds: int,
    ) -> HeldConstants:
        """The same first constants for every seed.

        Arguments:
            problem: see :class:`HeldConstants`.
            first: with the constants of the expert alone.
            windows: of the training set, (T1, 1, N, *state).
        """
        names, settings = [p.name for p in system.expert_parameters], first.settings
        shared = first.shared or {}
        sensors = SensorCoordinates.of(system, settings.of_sensors, windows.double())
        expert = LogCoordinates.of(system, {name: constant.value for name, constant in shared.items()})
        parameters = [names.index(name) for name in settings.shared]
        values = torch.cat((expert.shared[parameters], sensors.coordinates(first.sensors or {})))
        return cls(problem, parameters, sensors, values.repeat(seeds, 1))

    def hold(self, fits: Iterable[WindowFit]) -> None:
        """Let fits of windows, stacked over the same seeds, hold the constants; fits of the expert alone, whose decoder
        all seeds share, those of the first seed."""
        of_parameters, of_sensors = self.values.tensor_split([len(self.parameters)], dim=-1)
        for fit in fits:
            seeds = slice(None) if any(True for _ in fit.decoder.parameters()) else slice(1)
            fit.hold(self.parameters, of_parameters[seeds])
            fit.decoder.sensors = self._sensors(of_sensors[seeds])

    def refit(self, model: Decoder, windows: Tensor, x: Tensor) -> Tensor:
        """Fit the constants with F_a as it is; windows' own coordinates (S, N, K) there.

        Arguments:
            model: stacked over the seeds.
            windows: (T1, 1, N, *observed), float64.
            x: the windows' own coordinates now, (S, N, K).
        """
        seeds, coordinates = len(self.values), []
        for k in range(seeds):
            decoder = select(model, [k], seeds)
            decoder.sensors = None
            sensed = SensedFit(self.problem(decoder), self.sensors)
            size = sum(sensed.fit.sizes)
            places = [*self.parameters, *range(size, size + len(self.sensors.sought))]
            own = [j for j in range(len(sensed.longest)) if j not in places]
            whole = x.new_zeros(1, x.shape[1], len(sensed.longest))
            whole[..., own], whole[..., places] = x[k], self.values[k]
            whole, *_ = minimise_together(sensed, windows, whole, places, TOLERANCE, STEPS)
            self.values[k] = whole[0, 0, places]
            coordinates.append(whole[0][:, own])
        return torch.stack(coordinates)

    def _sensors(self, coordinates: Tensor) -> Sensors | None:
        return self.sensors.sensors(coordinates.unsqueeze(1)) if self.sensors.sought else None
