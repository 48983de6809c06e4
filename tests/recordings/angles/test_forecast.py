"""Forecasts of the rigid double pendulum."""

from __future__ import annotations

import numpy as np
import torch
from pendulum_motion import CONSTANTS

from expertaug.systems.double_pendulum import energy
from expertaug_recordings.angles.forecast import forecast


def test_forecast_conserves_energy_and_converges():
    start = torch.tensor([[2.5, 1.0, 3.0, -5.0]], dtype=torch.float64)
    coarse, fine = (forecast(start, 20, 0.01, CONSTANTS, step=h) for h in (0.005, 0.001))
    levels = energy(coarse.numpy(), CONSTANTS)
    assert np.ptp(levels) < 1e-3 * levels.mean()
    assert float((coarse - fine).abs().max()) < 1e-3
