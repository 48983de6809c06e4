"""Swings that friction damps, and fits of them by an expert who knows none: what the tests of equations share."""

from __future__ import annotations

import numpy as np

import expertaug as ea

T = np.arange(21) * 0.2
NOISE, SEEN = 0.02, 2.0


def swings(name, n=16, seed=0, alpha=(0.1, 0.6)):
    ranges = {"omega0": (1.5, 3.1)}, {"alpha": alpha}
    return ea.simulate(ea.DampedPendulum(), *ranges, n=n, t=T, noise=NOISE, seed=seed, name=name)


def fitted(train, system=None, **options):
    how = {"prior": {"omega0": (1.0, 3.5)}} | options
    return ea.least_squares(system or ea.DampedPendulum(), train, observed_s=SEEN, noise=NOISE, **how)
