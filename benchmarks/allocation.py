"""What it is worth that commands keep freed memory (``expertaug.cli.keep_freed_memory``): forecasts of a hybrid model
from many draws, processor time in the program and in the system, and peak memory, a process each.

python benchmarks/allocation.py [--draws 8] [--rounds 2]
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before torch

import torch

from expertaug.cli import keep_freed_memory
from expertaug.models.decoder import Decoder
from expertaug.models.interactions.mlp import MLPInteraction
from expertaug.models.stacking import stack
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.solvers.solver import Solver

SEEDS, WINDOWS = 3, 1000


@torch.no_grad()
def measured(kept: bool, draws: int) -> tuple[float, float, float]:
    """Seconds in the program and in the system, and the peak of memory in MiB."""
    if kept and not keep_freed_memory():
        raise SystemExit("this C library has no mallopt")
    torch.manual_seed(0)
    system = DampedPendulum()
    learned = {"layers": [64, 64], "activation": "selu", "components": ["omega"]}
    decoder = stack([Decoder(system, MLPInteraction(system, 1, **learned)) for _ in range(SEEDS)])
    shape, solver, t = (SEEDS, draws * WINDOWS), Solver("dopri5", 1e-6, 1e-6), torch.linspace(0.0, 20.0, 201)
    y0, z_e, z_a = 0.5 * torch.randn(*shape, 2), 0.5 + 2 * torch.rand(*shape, 1), torch.randn(*shape, 1)
    before = resource.getrusage(resource.RUSAGE_SELF)
    decoder.forecast(y0, z_e, z_a, t, solver)
    after = resource.getrusage(resource.RUSAGE_SELF)
    return after.ru_utime - before.ru_utime, after.ru_stime - before.ru_stime, after.ru_maxrss / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=8, help="of each window")
    parser.add_argument("--rounds", type=int, default=2)
    options = parser.parse_args()
    for _ in range(options.rounds):
        for kept in (False, True):
            with multiprocessing.get_context("spawn").Pool(1) as pool:  # what a process is told holds for all of it
                program, system, peak = pool.apply(measured, (kept, options.draws))
            name = "freed memory kept" if kept else "as the C library has it"
            print(
                f"{name:24} {program:6.1f} s in the program, {system:5.1f} s in the system, {peak:5.0f} MiB", flush=True
            )


if __name__ == "__main__":
    main()
