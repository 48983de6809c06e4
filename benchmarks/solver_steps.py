"""How to step in training and evaluation: `python benchmarks/solver_steps.py`.

Forecast of a hybrid model as long as its evaluation's, and its gradient, on one thread: of the pendulum and the circuit
by Runge-Kutta, Adams-Bashforth steps and by tolerance, of reaction–diffusion by steps with and without the diffusion
exact in Fourier space; the largest error and the root mean square are against a solve by a tight tolerance.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping

os.environ["OMP_NUM_THREADS"] = "1"

import torch
from torch import Tensor

from expertaug import systems
from expertaug.models.hybrid import HybridModel
from expertaug.systems.solvers.solver import Solver
from training_step import median_time

SEEDS, STEP = 3, 0.1
WINDOW = {"kind": "window", "windows": {"theta": [0.0, 5.0], "omega": [0.0, 5.0]}, "layers": [8], "latent": 1}
MLP = {"kind": "mlp", "layers": [16, 16], "activation": "silu", "components": ["omega"]}
CNN = {"kind": "conv", "channels": [16], "kernels": [3, 1], "start": 0.01}
BY_TOLERANCE = [Solver("dopri5", tolerance, tolerance) for tolerance in (1e-5, 1e-6)]
CASES = {
    "pendulum, 20 s": (
        [Solver("rk4"), Solver("ab4", substeps=2), Solver("ab5", substeps=2), Solver("ab5", substeps=4), *BY_TOLERANCE],
        {"name": "pendulum"}, WINDOW, MLP, [1.5], [3.1], 100, 201,
    ),
    "circuit, 20 s": (
        [Solver("rk4"), Solver("ab4", substeps=2), Solver("ab5", substeps=4), *BY_TOLERANCE],
        {"name": "rlc"}, WINDOW | {"windows": {"U": [0.0, 5.0], "I": [0.0, 5.0]}}, MLP | {"components": ["I"]},
        [1.0, 0.5], [3.0, 1.5], 100, 201,
    ),
    "reaction–diffusion, 5 s": (
        [*(Solver("rk4", substeps=n) for n in (1, 4)), *(Solver(method) for method in ("lawson4", "ab4", "ab5"))],
        {"name": "reaction_diffusion", "reaction": "without_k"}, {"kind": "moments"}, CNN,
        [0.001, 0.003], [0.002, 0.007], 10, 51,
    ),
}  # fmt: skip
Forecast = Callable[..., tuple[Tensor, Tensor]]


def case(
    name: Mapping, encoder: Mapping, interaction: Mapping, low: list, high: list, samples: int, points: int
) -> Forecast:
    """Forecasts of an untrained model from a simulation's first points."""
    torch.manual_seed(0)
    generator = torch.Generator().manual_seed(0)
    system, t = systems.load(name), torch.arange(points) * STEP
    model = HybridModel(system, encoder, interaction).build(t.tolist(), list(range(SEEDS)))
    y0 = system.sample_initial_state(SEEDS * samples, generator).unflatten(0, (SEEDS, samples))
    share = torch.rand(SEEDS, samples, len(low), generator=generator)
    z_e = torch.lerp(torch.tensor(low), torch.tensor(high), share)
    z_a = torch.randn(SEEDS, samples, 1, generator=generator)

    def forecast(solver: Solver, dtype: torch.dtype = torch.float32) -> tuple[Tensor, Tensor]:
        """States, and the z_e (a leaf) that they depend on."""
        known = z_e.to(dtype).requires_grad_()
        return model.to(dtype).forecast(y0.to(dtype), known, z_a.to(dtype), t.to(dtype), solver), known

    return forecast


def main() -> None:
    """Print time and error of every way."""
    torch.set_num_threads(1)
    for title, (ways, *settings) in CASES.items():
        forecast = case(*settings)
        exact = forecast(Solver("dopri5", 1e-9, 1e-9), torch.float64)[0].detach()
        for solver in ways:

            def step(by: Solver = solver, of: Forecast = forecast) -> None:
                y, z_e = of(by)
                torch.autograd.grad(y.square().sum(), z_e)

            seconds, wrong = median_time(step, 3), forecast(solver)[0].detach() - exact
            label = solver.method + (f" at {solver.rtol:g}" if solver.method == "dopri5" else f" × {solver.substeps}")
            size = float(wrong.square().mean().sqrt())
            print(f"{title:24} {label:14} {1e3 * seconds:7.0f} ms   error {float(wrong.abs().max()):.1e}, {size:.1e}")


if __name__ == "__main__":
    main()
