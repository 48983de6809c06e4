"""Do intervals of z_e hold better when the seeds' posteriors are pooled?  Of each seed, and of all together.

    python benchmarks/pooled_seeds.py results/pendulum [--version alternating+~flow]

The folder is an experiment's of a run that has trained the version, a flow, with its seeds in one file.  Printed for
each set: the share of windows whose true parameters lie in the central 50 % and 90 % intervals.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import expertaug as ea
from expertaug.inference.diagnostics.calibration import TABLE_LEVELS
from expertaug.trajectories import Trajectories

DRAWS = 119  # of each seed


def main() -> None:
    """Print a line for each set and parameter."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--version", default="alternating+~flow")
    parser.add_argument("--seed-group", default="seeds_0_1_2")
    parser.add_argument("--windows", type=int, default=1000)
    options = parser.parse_args()
    model = ea.load(options.folder / options.version / options.seed_group / "model.safetensors")
    t, seeds = model.t[: model.observed], len(model)
    for name in ("validation", "iid", "test"):
        data = Trajectories.load(options.folder / f"data/{name}.npz").spread(options.windows)
        found = ea.predictive(model, data.seen[:, : len(t)], t, draws=DRAWS, pooled=False)
        for k, (parameter, draws) in enumerate(found.z_e.items()):
            below = [ea.diagnostics.ranks(draws[:, seed], data.z_e[:, k]) for seed in range(seeds)]
            each = [ea.diagnostics.interval_coverage(one, DRAWS, TABLE_LEVELS).share for one in below]
            pooled = ea.diagnostics.interval_coverage(np.sum(below, axis=0), DRAWS * seeds, TABLE_LEVELS).share
            single, together = (" and ".join(f"{100 * x:.0f}" for x in one) for one in (np.mean(each, axis=0), pooled))
            of_seeds = ", ".join(f"{100 * one[1]:.0f}" for one in each)
            print(
                f"{name} {parameter}: 50 % and 90 % intervals hold {together} % pooled, {single} % by seed "
                f"(90 %: {of_seeds}); {len(data)} windows",
                flush=True,
            )


if __name__ == "__main__":
    main()
