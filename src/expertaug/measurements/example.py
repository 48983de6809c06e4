"""A table of measurements to try the commands on, as a lab writes it."""

from __future__ import annotations

import numpy as np

COLUMNS = "trial,time [ms],angle [deg]"
STEP_S = 0.05  # from row to row
SUBSTEPS = 25  # of the solver
NOISE_DEG = 0.2
LOST = 0.02  # share of the rows that a logger has lost


def table(trials: int = 20, seconds: float = 30.0, seed: int = 0) -> str:
    """A CSV of simulated swings: pendulums of different lengths with a friction, each let go at another angle.

    Arguments:
        trials: how many swings.
        seconds: how long each lasts.
        seed: of frequencies, frictions, noise and lost rows.
    """
    generator = np.random.default_rng(seed)
    omega0, alpha = generator.uniform(1.6, 2.4, trials), generator.uniform(0.05, 0.15, trials)
    angle, speed = generator.uniform(0.2, 1.2, trials), np.zeros(trials)
    steps, step = round(seconds / STEP_S), STEP_S / SUBSTEPS
    angles = np.empty((trials, steps + 1))
    for k in range(steps + 1):
        angles[:, k] = angle
        for _ in range(SUBSTEPS):  # symplectic Euler: its error is far below the noise
            speed = speed - step * (omega0**2 * np.sin(angle) + alpha * speed)
            angle = angle + step * speed
    shown = np.degrees(angles) + generator.normal(0.0, NOISE_DEG, angles.shape)
    rows = np.argwhere(generator.random(angles.shape) >= LOST)
    lines = [f"{trial},{round(1000 * STEP_S * k)},{shown[trial, k]:.2f}" for trial, k in rows]
    return "\n".join([COLUMNS, *lines]) + "\n"
