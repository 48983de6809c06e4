"""Do intervals of z_e hold better when the seeds' posteriors are pooled?  Of each seed, and of all together.

    python benchmarks/pooled_seeds.py results/pendulum [--version alternating+~flow]

The folder is an experiment's of a run that has trained the version, whose flow must be a group of seeds in one file.
Printed for each set: the share of windows whose true parameters lie in the central 50 % and 90 % intervals.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch

from expertaug.evaluation.evaluate import spread
from expertaug.inference import store
from expertaug.inference.coverage import TABLE_LEVELS, interval_coverage
from expertaug.inference.posterior_draws import z_e_draws
from expertaug.inference.ranks import ranks
from expertaug.models.device import device_of
from expertaug.trajectories import Trajectories


@torch.no_grad()
def main() -> None:
    """Print a line for each set and parameter."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--version", default="alternating+~flow")
    parser.add_argument("--seed-group", default="seeds_0_1_2")
    parser.add_argument("--sets", nargs="+", default=["validation", "iid", "test"])
    parser.add_argument("--windows", type=int, default=1000)
    options = parser.parse_args()
    stored = store.load(
        options.folder / options.version / options.seed_group / "model.safetensors", device_of("cpu"), ()
    )
    names = [p.name for p in stored.model.system.expert_parameters]
    for name in options.sets:
        data = spread(Trajectories.load(options.folder / f"data/{name}.npz"), options.windows)
        y = torch.from_numpy(data.seen).movedim(1, 0)[: stored.description["observed"]].unsqueeze(1)
        draws = z_e_draws(stored.model.estimate(y.expand(-1, len(stored.seeds), *y.shape[2:])))
        assert draws is not None
        below = np.stack([ranks(one.movedim(1, 0).double().numpy(), data.z_e) for one in draws])
        count = draws.shape[2]
        each = [interval_coverage(one, count, TABLE_LEVELS).share for one in below]
        pooled = interval_coverage(below.sum(0), count * len(below), TABLE_LEVELS).share
        for k, parameter in enumerate(names):
            single, together = ([f"{100 * x:.0f}" for x in one[:, k]] for one in (np.mean(each, axis=0), pooled))
            of_seeds = ", ".join(f"{100 * one[1, k]:.0f}" for one in each)
            print(
                f"{name} {parameter}: 50 % and 90 % intervals hold {' and '.join(together)} % pooled, "
                f"{' and '.join(single)} % by seed (90 %: {of_seeds}); {len(data)} windows",
                flush=True,
            )


if __name__ == "__main__":
    main()
