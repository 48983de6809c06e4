"""What speeds miss of the motion between frames far apart, by the motion of the pendulum that was fitted to it.

A speed from finite differences errs by what the angle does between its frames, which the frames themselves hardly
tell.  The equation of motion does: started from a frame's state, forwards and backwards, it gives the angles at the
neighbouring frames, whose differences are off that state's speed by as much as the measured ones are off the truth.
The speeds stay as they were measured; only their stated uncertainty is by the equation.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from expertaug_recordings.angles.forecast import forecast
from expertaug_recordings.angles.noise import Noise
from expertaug_recordings.angles.pendulum_fit import Fit
from expertaug_recordings.angles.smoothing import Motion
from expertaug_recordings.angles.windows import Window

LEAST_R2 = 0.75  # of the fit to the changes of speed; below, the pendulum is no guide to the motion


def with_motion_between(motion: Motion, fit: Fit, noise: Noise, rate: float) -> Motion:
    """The motion with uncertainties of finite differences by the fitted pendulum's own motion.

    Arguments:
        motion: as it was measured.
        fit: of the pendulum to it.
        noise: of the angles.
        rate: frames per second.
    """
    if min(fit.r2) < LEAST_R2:
        return motion
    std = motion.std.copy()
    for reach in np.unique(motion.reach[motion.reach > 0]):
        weights = Window(reach, 2 * reach, -1).weights(1, rate)
        frames = np.flatnonzero((motion.reach == reach).any(1))
        states = np.nan_to_num(motion.y[frames])
        bias = np.einsum("nfk,f->nk", _neighbours(states, fit, reach, 1 / rate), weights) - states[:, 2:]
        told = np.sqrt([noise.variance(weights, k) for k in (0, 1)] + bias**2)
        stated = std[frames, 2:]
        better = (motion.reach[frames] == reach) & np.isfinite(stated) & np.isfinite(told)
        std[frames, 2:] = np.where(better, told, stated)
    return replace(motion, std=std)


def _neighbours(states: np.ndarray, fit: Fit, reach: int, interval: float) -> np.ndarray:
    """Angles (n, 2 reach + 1, 2) before, at and after each of the states (n, 4)."""
    constants, sides = fit.constants, []
    if constants.B2 == 0:  # a single pendulum: what hangs on it does nothing (B1 = 0), and may be anything
        constants = replace(constants, B2=1.0)
    for sign in (-1, 1):  # backwards in time, speeds and friction change their sign
        start = torch.as_tensor(states * [1, 1, sign, sign])
        friction = (sign * fit.friction[0], sign * fit.friction[1])
        sides.append(forecast(start, reach + 1, interval, constants, friction)[..., :2].numpy())
    return np.concatenate((sides[0][:, :0:-1], sides[1]), axis=1)
