"""Forecasts of the rigid double pendulum, batched."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from expertaug.systems.double_pendulum import Constants, accelerations
from expertaug_recordings import runge_kutta


def forecast(
    y0: Tensor,
    times: int,
    interval: float,
    constants: Constants | None,
    friction: tuple[float, float] = (0.0, 0.0),
    step: float = 0.005,
) -> Tensor:
    """States by classical Runge-Kutta steps.

    Arguments:
        y0: initial states (N, 4).
        times: number of points, the first of which is ``y0``.
        interval: seconds between points.
        constants: the rigid body's; None forecasts constant speeds.
        friction: viscous friction of the joints in s⁻¹.
        step: longest step in s.

    Returns:
        (N, times, 4).
    """
    substeps = max(1, math.ceil(interval / step - 1e-9))
    h = interval / substeps

    def slope(y: Tensor) -> Tensor:
        speeds = y[..., 2:]
        second = torch.zeros_like(speeds) if constants is None else accelerations(y, constants, friction)
        return torch.cat((speeds, second), dim=-1)

    y, points = y0, [y0]
    for _ in range(times - 1):
        for _ in range(substeps):
            y = runge_kutta.step(slope, y, h)
        points.append(y)
    return torch.stack(points, dim=1)
