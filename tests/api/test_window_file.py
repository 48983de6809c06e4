"""What the terminal says of each trajectory's forecast."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from expertaug.api.window_file import _describe

NOBODY_SAID = {"z_e_std": {}, "chi2": None, "p_chi2": None, "outside": None, "doubts": None}


def verdicts(trusted):
    """The last part of the line of each trajectory, for verdicts (seeds, trajectories)."""
    trusted = np.array(trusted)
    z_e = {"omega0": np.full(trusted.shape, 2.0)}
    seeds = range(len(trusted))
    given = {"seeds": seeds, "t": np.arange(5.0), "z_e": z_e, "units": {"z_e omega0": "rad/s"}, "trusted": trusted}
    found = SimpleNamespace(names=[str(k) for k in range(trusted.shape[1])], start_s=np.zeros(trusted.shape[1]))
    lines = _describe(SimpleNamespace(**given, **NOBODY_SAID), found, 3)
    return [line.rpartition("rad/s, ")[2] for line in lines]


def test_a_verdict_counts_the_seeds_that_distrust_a_window():
    """Not those that trust it: one of three that does is no reason to call it distrusted by a third."""
    assert verdicts([[True, True, False], [True, False, True], [True, False, True]]) == [
        "to be trusted",
        "not to be trusted (2 of 3 seeds distrust it)",
        "not to be trusted (1 of 3 seeds distrust it)",
    ]


def test_a_single_seed_is_not_counted():
    assert verdicts([[True, False]]) == ["to be trusted", "not to be trusted"]
