"""How to step reaction–diffusion over the observed window: `python benchmarks/stiff_steps.py`.

Forecast of a hybrid model and its gradient, on one thread, by Runge-Kutta with one or more steps in a data interval and
by Lawson steps, which have the diffusion exact in Fourier space; and the largest error against a solve by tolerance.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import torch
from torch import Tensor

from expertaug import systems
from expertaug.models.recipe import HybridModel
from expertaug.systems.solver import Solver
from training_step import median_time

SEEDS, SAMPLES, POINTS, STEP = 3, 10, 11, 0.1
WAYS = {f"rk4, {n} steps": Solver("rk4", substeps=n) for n in (1, 2, 4, 8)} | {"lawson4, 1 step": Solver("lawson4")}


def main() -> None:
    """Print time and error of every way."""
    torch.set_num_threads(1)
    torch.manual_seed(0)
    system, t = systems.load({"name": "reaction_diffusion", "reaction": "without_k"}), torch.arange(POINTS) * STEP
    model = HybridModel(system, {"kind": "moments"}, {"kind": "polynomial"}).build_one(t)
    y0 = torch.rand(SEEDS, SAMPLES, *system.state_shape)
    z_e = torch.tensor([0.002, 0.007]).expand(SEEDS, SAMPLES, 2).clone().requires_grad_()
    z_a = torch.zeros(SEEDS, SAMPLES, 1)

    def forecast(solver: Solver) -> Tensor:
        return model.forecast(y0, z_e, z_a, t, solver)

    with torch.no_grad():
        exact = forecast(Solver("dopri5", 1e-7, 1e-7))
        errors = {name: float((forecast(solver) - exact).abs().max()) for name, solver in WAYS.items()}
    for name, solver in WAYS.items():
        seconds = median_time(lambda s=solver: torch.autograd.grad(forecast(s).square().sum(), z_e), 7)
        print(f"{name:16} {1e3 * seconds:7.0f} ms   largest error {errors[name]:.1e}")


if __name__ == "__main__":
    main()
