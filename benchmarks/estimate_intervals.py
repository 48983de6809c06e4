"""Do 90 % intervals of estimates hold?  ``python benchmarks/estimate_intervals.py`` (five minutes of a free core).

Damped pendulums of one frequency and friction are simulated with noise .02 and cut into windows of 2 s, of which each
begins .5 s after the one before and overlaps it.  Both parameters are fitted to each window and, once more, shared by
all.  Prints, for a number of trajectories and their length, how many of the intervals of ``model.estimates`` hold the
truth: of the shared value, of the mean of all trajectories, and of each trajectory.
"""

from __future__ import annotations

import argparse

import numpy as np
import torch

import expertaug as ea
from expertaug.trajectories import Trajectories

OMEGA0, ALPHA, NOISE, STEP, POINTS, STRIDE = 1.7, 0.15, 0.02, 0.1, 21, 5
PRIOR = {"omega0": (1.0, 3.0), "alpha": (0.01, 0.5)}
BOTH = {"omega0": "shared", "alpha": "shared"}


def windows(trajectories: int, points: int, seed: int) -> Trajectories:
    """Overlapping windows of some trajectories of one pendulum."""
    ranges = {"omega0": (OMEGA0, OMEGA0)}, {"alpha": (ALPHA, ALPHA)}
    t = STEP * np.arange(points)
    y = ea.simulate(ea.DampedPendulum(), *ranges, n=trajectories, t=t, noise=NOISE, name=f"set {seed}").y
    places = [(k, first) for k in range(trajectories) for first in range(0, points - POINTS + 1, STRIDE)]
    cut = np.stack([y[k, first : first + POINTS] for k, first in places])
    return Trajectories(t[:POINTS], cut, np.full((len(cut), 2), np.nan), id=np.array([f"{k}/{f}" for k, f in places]))


def main() -> None:
    """Print a line for each design."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=60)
    parser.add_argument("--trajectories", type=int, nargs="*", default=[1, 5, 10])
    parser.add_argument("--points", type=int, default=61)
    options = parser.parse_args()
    torch.set_num_threads(1)
    system, truth = ea.DampedPendulum(friction="estimated"), {"omega0": OMEGA0, "alpha": ALPHA}
    for count in options.trajectories:
        held: dict[tuple[str, str], list[bool]] = {}
        for seed in range(options.sets):
            data = windows(count, options.points, seed)
            for units in ({}, BOTH):
                fitting = {"observed_s": float(data.t[-1]), "prior": PRIOR, "noise": NOISE}
                model = ea.least_squares(system, data, **fitting, **({"units": units} if units else {}))
                for _, row in model.estimates(data).iterrows():
                    kind = row["of"] if row["of"].startswith("all") else "each trajectory"
                    inside = row["low"] <= truth[row["parameter"]] <= row["high"]
                    held.setdefault((kind, row["parameter"]), []).append(bool(inside))
        shares = [f"{kind} {name} {100 * np.mean(one):.0f} % of {len(one)}" for (kind, name), one in held.items()]
        print(f"{count} trajectories of {options.points} points: {', '.join(shares)}", flush=True)


if __name__ == "__main__":
    main()
