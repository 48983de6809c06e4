"""What the mean forecast of a flow loses, and saves, when it is made from fewer draws: on the validation set.

    python benchmarks/flow_forecasts.py results/pendulum [--version aphynity+~flow] [--windows 100]

The folder is an experiment's of a finished run.  Printed for each number of draws: log-MSE of every seed, its median
over windows, and processor time.  The key ``flow.forecasts`` sets it.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import torch

from expertaug.cli import keep_freed_memory
from expertaug.inference.flow import load
from expertaug.learning.divergence import BoundedSolver, bound_of_card
from expertaug.models.store import device_of
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows

DRAWS = (119, 64, 32, 16, 8)


@torch.no_grad()
def main() -> None:
    """Print a line for each number of draws."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--version", default="aphynity+~flow")
    parser.add_argument("--seed-group", default="seeds_0_1_2")
    parser.add_argument("--windows", type=int, default=100)
    options = parser.parse_args()
    keep_freed_memory()
    device = device_of("cpu")
    stored = load(options.folder / options.version / options.seed_group / "model.safetensors", device, ())
    data = Trajectories.load(options.folder / "data/validation.npz").spread(options.windows)
    whole, observed = Windows.of(data), stored.card.observed
    windows = whole.observed(observed).expand(len(stored.seeds))
    found = stored.model.estimate(windows)
    solver, bound = Solver("dopri5", rtol=1e-6, atol=1e-6), bound_of_card(stored.card, device)
    assert found.draws is not None and bound is not None
    for draws in DRAWS:
        stored.model.forecasts = draws
        some = replace(found, draws=tuple(value[..., :draws, :] for value in found.draws))
        start = time.process_time()
        states = stored.model.predicted(some, windows, BoundedSolver(solver, bound))
        seconds = time.process_time() - start
        errors = (states - whole.y)[observed:].square().flatten(3).sum(-1).nanmean(0)
        each = (errors.mean(1).log().tolist(), errors.median(1)[0].log().tolist())
        means, medians = (", ".join(f"{value:.2f}" for value in one) for one in each)
        print(f"{draws:4d} draws: log-MSE {means}; medians {medians}; {seconds:.2f} CPU-s", flush=True)


if __name__ == "__main__":
    main()
