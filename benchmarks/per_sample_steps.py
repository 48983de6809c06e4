"""A step size and a status for each sample, against one for a batch: `python benchmarks/per_sample_steps.py`.

Needs torchode (`pip install --no-deps torchode torchtyping typeguard`), which no other part of the project does.  By
dopri5 at equal tolerances, on one thread, interleaved: pendulums as they are simulated; the same with a hundredth of
them ten times as fast; and with a hundredth running away to infinity within the time.  Ours is torchdiffeq's
dopri5, with what the project has around it: batches that need far more steps than others do, or cannot be solved, are
taken in pieces (`expertaug.learning.divergence.solve_with_sample_fallback`), and what runs away is left at a bound;
torchode gives such a sample up after a number of steps.  Errors are the largest of the others, against a tolerance of
1e-9.

`python benchmarks/per_sample_steps.py MODEL SET ...` does the same with forecasts of a trained model for the windows of
a set, all its seeds together, by the tolerances that evaluations use: `results/rlc/aphynity+/seeds_0_1_2/
model.safetensors results/rlc/data/test.npz`.
"""

from __future__ import annotations

import os
import sys

os.environ["OMP_NUM_THREADS"] = "1"

import time
from collections.abc import Callable

import numpy as np
import torch
import torchode
from torch import Tensor

from expertaug.learning.divergence import BoundedSolver, bound_of_card, solve_with_sample_fallback
from expertaug.models import store
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows

SAMPLES, REPEATS, TOLERANCE, STEPS = 200, 3, 1e-6, 3_000
T = torch.linspace(0.0, 10.0, 101, dtype=torch.float64)
BOUND = torch.tensor([1e3, 1e3])
START = torch.tensor([1.0, 0.0], dtype=torch.float64)


def swing(y: Tensor, omega0: Tensor, growth: Tensor) -> Tensor:
    """Rates of pendulums whose speed grows by itself where ``growth`` is not 0."""
    theta, omega = y.unbind(-1)
    return torch.stack((omega, growth * omega**3 - omega0**2 * torch.sin(theta)), dim=-1)


def by_torchode(omega0: Tensor, growth: Tensor, tolerance: float = TOLERANCE) -> Tensor:
    """States (N, T, 2), as torchode's own documentation puts its parts together."""
    term = torchode.ODETerm(lambda _, y: swing(y, omega0, growth))
    method, controller = torchode.Dopri5(term), torchode.IntegralController(tolerance, tolerance, term=term)
    solver = torchode.AutoDiffAdjoint(method, controller, max_steps=STEPS)
    problem = torchode.InitialValueProblem(y0=START.expand(len(omega0), 2), t_eval=T.expand(len(omega0), -1))
    return solver.solve(problem).ys


def by_batches(omega0: Tensor, growth: Tensor, tolerance: float = TOLERANCE) -> Tensor:
    """The same by the project."""
    solver = Solver("dopri5", rtol=tolerance, atol=tolerance)

    def predicted(part: slice, bounded: BoundedSolver) -> Tensor:
        y0 = START.expand(1, len(omega0[part]), 2)
        return bounded(lambda _, y: swing(y, omega0[part], growth[part]), y0, T)

    states, _ = solve_with_sample_fallback(predicted, len(omega0), solver, BOUND)
    return states[:, 0].transpose(0, 1)


def seconds(solve: Callable[..., Tensor], *pendulums: Tensor) -> float:
    """CPU time of one solve."""
    begun = time.process_time()
    solve(*pendulums)
    return time.process_time() - begun


class Taken(Exception):
    """The rates that a model hands to a solver."""


@torch.no_grad()
def of_model(model: str, data: str) -> None:
    """Print a line for forecasts of a set by a trained model."""
    stored, truth = store.load(model), Trajectories.load(data)
    whole, seeds = Windows.of(truth.spread(SAMPLES)), len(stored.seeds)
    windows = whole.observed(stored.card.observed).expand(seeds)
    estimates = stored.model.estimate(windows)
    z_e, z_a, y0 = estimates.z_e, estimates.z_a, windows.y[0]
    decoder, bound, t = stored.model.decoder, bound_of_card(stored.card, y0.device), whole.t
    solver = store.accurate(decoder.system)

    def ours(tolerance: float = solver.rtol) -> Tensor:
        finer = Solver(solver.method, rtol=tolerance, atol=solver.atol * tolerance / solver.rtol)

        def predicted(part: slice, bounded: BoundedSolver) -> Tensor:
            return decoder.forecast(y0[:, part], z_e[:, part], z_a[:, part], t, bounded)

        return solve_with_sample_fallback(predicted, y0.shape[1], finer, bound)[0]

    def take(rates: Callable[..., Tensor], start: Tensor, *_: object, **__: object) -> Tensor:
        raise Taken(rates, start)

    take.splits = False  # type: ignore[attr-defined]
    try:
        decoder.forecast(y0, z_e, z_a, t, take)
    except Taken as taken:
        rates, start = taken.args
    term = torchode.ODETerm(lambda s, y: rates(s.view(start.shape[:2]), y.view_as(start)).flatten(0, 1))
    methods = {"dopri5": torchode.Dopri5, "tsit5": torchode.Tsit5}

    def theirs(method: str) -> Tensor:
        controller = torchode.IntegralController(solver.atol, solver.rtol, term=term)
        adjoint = torchode.AutoDiffAdjoint(methods[method](term), controller, max_steps=STEPS)
        problem = torchode.InitialValueProblem(y0=start.flatten(0, 1), t_eval=t.expand(start[..., 0].numel(), -1))
        return adjoint.solve(problem).ys.unflatten(0, start.shape[:2]).movedim(2, 0)

    ways = {f"torchode, {method}": lambda method=method: theirs(method) for method in methods} | {
        f"ours, {solver.method}": ours
    }
    exact, each = ours(solver.rtol / 100), {name: [] for name in ways}
    for _ in range(REPEATS):
        for name, way in ways.items():
            each[name].append(seconds(way))
    off = {name: float((way() - exact).abs().median()) for name, way in ways.items()}
    texts = [f"{name} {1000 * np.median(spent):.0f} ms, {off[name]:.0e}" for name, spent in each.items()]
    print(f"{stored.card.system_name}, {start.shape[1]} windows, {seeds} seeds", *texts, sep="; ")


@torch.no_grad()
def main() -> None:
    """Print a line a case."""
    torch.set_num_threads(1)
    if paths := sys.argv[1:]:
        for model, data in zip(paths[::2], paths[1::2], strict=True):
            of_model(model, data)
        return
    plain = torch.linspace(1.5, 3.1, SAMPLES, dtype=torch.float64)
    one_in = torch.arange(SAMPLES) % 100 == 50
    none = torch.zeros(SAMPLES, dtype=torch.float64)
    cases = {
        "alike": (plain, none),
        "1 % ten times as fast": (torch.where(one_in, 10 * plain, plain), none),
        "1 % run away": (plain, torch.where(one_in, 1.0, none)),
    }
    for name, (omega0, growth) in cases.items():
        times: dict[str, list[float]] = {"torchode": [], "ours": []}
        for _ in range(REPEATS):
            times["torchode"].append(seconds(by_torchode, omega0, growth))
            times["ours"].append(seconds(by_batches, omega0, growth))
        stays = growth == 0
        exact = by_batches(omega0[stays], growth[stays], 1e-9)
        off = {
            "torchode": (by_torchode(omega0, growth)[stays] - exact).abs().max().item(),
            "ours": (by_batches(omega0, growth)[stays] - exact).abs().max().item(),
        }
        print(
            name, *(f"{who} {1000 * np.median(spent):.0f} ms, {off[who]:.0e}" for who, spent in times.items()), sep="; "
        )


if __name__ == "__main__":
    main()
