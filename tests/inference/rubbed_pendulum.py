"""Windows of one pendulum with friction, whose parameters they share, and fits of all of them together."""

from __future__ import annotations

import numpy as np
import torch

import expertaug as ea
from expertaug.systems import Parameter, System
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories

T = np.arange(31) * 0.2
PRIOR = {"omega0": (1.0, 3.0), "alpha": (0.01, 0.5)}
NOISE, END = 0.02, 2.0
BOTH = {"omega0": "shared", "alpha": "shared"}


class Rubbed(System):
    """θ'' = −ω0² sin θ − α θ'."""

    state = (Parameter("theta", "rad"), Parameter("omega", "rad/s"))
    expert_parameters = (Parameter("omega0", "rad/s", scale=2.0), Parameter("alpha", "1/s", scale=0.3))

    def expert(self, t, y, z_e):
        (theta, omega), (omega0, alpha) = y.unbind(-1), z_e.unbind(-1)
        return torch.stack((omega, -(omega0**2) * torch.sin(theta) - alpha * omega), dim=-1)


def swings(n, seed=0, omega0=1.7, alpha=0.15, noise=NOISE, t=T):
    """Windows of one pendulum, or, by arrays (n,), of several."""
    ranges = {"omega0": (1.0, 1.0)}, {"alpha": (0.0, 0.0)}
    y0 = ea.simulate(ea.DampedPendulum(), *ranges, n=n, t=t[:2], noise=0.0, seed=seed).y[:, 0]
    z_e = np.stack(np.broadcast_arrays(omega0, alpha, np.zeros(n)), 1)[:, :2]
    true, start = torch.from_numpy(z_e).double(), torch.from_numpy(y0).double()
    y = Solver("dopri5", rtol=1e-6, atol=1e-6)(lambda s, y: Rubbed().expert(s, y, true), start, torch.from_numpy(t))
    y = y.numpy() + noise * np.random.default_rng(seed).normal(size=y.shape)
    return Trajectories(t, np.swapaxes(y, 0, 1), z_e)


def fitted(data, **options):
    return ea.least_squares(Rubbed(), data, observed_s=END, prior=PRIOR, noise=NOISE, **options)


EXPERIMENT = """
run: [swings]
seeds: [0, 1]
experiments:
  swings:
    based_on: pendulum
    data: {t1_s: 2.0, noise: 0.02}
    augmentation: {prior: {omega0: [1.0, 3.0]}}
    augmentations: {narrow: null, wide: null}
    model: {encoder: {windows: {theta: [0.0, 2.0], omega: [0.0, 2.0]}}}
    refinement: {units: {omega0: shared}}
    methods: [least_squares, least_squares_shared]
    augmented: []
    controls: []
    flows: []
    refined: []
"""
