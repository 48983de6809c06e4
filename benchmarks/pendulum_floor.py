"""What the noise lets the pendulum's forecasts reach: ``python benchmarks/pendulum_floor.py [RESULTS]`` (two minutes).

The *true* equation is fitted by least squares to each observed window of the validation and the test set, from the true
parameters on, and scored as a model is (log-MSE over (t1, t2], in the paper's sum over both components): once starting
from the noisy y0, as all models here and in the paper do, and once with the start fitted as well; no model takes part.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from scipy.optimize import least_squares

from expertaug import systems
from expertaug.evaluation.metrics import log_mse
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories

OBSERVED_S = 5.0


def main() -> None:
    """Print a line for each set and kind of start."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="?", default=Path("results"))
    options = parser.parse_args()
    torch.set_num_threads(1)
    for name in ("validation", "test"):
        floor(name, Trajectories.load(options.results / "pendulum" / "data" / f"{name}.npz"))


def floor(name: str, truth: Trajectories) -> None:
    """Print what fits of one set reach."""
    system, solver = systems.load({"name": "pendulum"}), Solver("rk4")
    t, observed = torch.from_numpy(truth.t).double(), int(np.searchsorted(truth.t, OBSERVED_S + 1e-9))

    def states(x: np.ndarray, y0: np.ndarray, times: torch.Tensor) -> torch.Tensor:
        """x = (ω0, α), and y0 where it is fitted → states (T, 2)."""
        start, z_e, z_a = (torch.from_numpy(v).double() for v in (x[2:] if len(x) > 2 else y0, x[:1], x[1:2]))
        return solver(lambda time, y: system.truth(time, y, z_e, z_a), start, times)

    def fitted(y: np.ndarray, z_e: np.ndarray, z_a: np.ndarray, free: bool) -> torch.Tensor:
        """Forecast (T, 2) of the least-squares fit to the window of y (T, 2)."""
        first = np.concatenate((z_e, z_a, y[0] if free else []))
        found = least_squares(lambda x: (states(x, y[0], t[:observed]).numpy() - y[:observed]).ravel(), first)
        return states(found.x, y[0], t)

    y = torch.from_numpy(truth.y).movedim(1, 0)[observed:].unsqueeze(1)
    for start, free in (("from the noisy y0", False), ("with the start fitted", True)):
        each = [fitted(*one, free) for one in zip(truth.y.astype(float), truth.z_e, truth.z_a, strict=True)]
        score = log_mse(system, torch.stack(each, 1)[observed:].unsqueeze(1), y)["log_mse_sum"]
        print(f"{name}, {start}: log-MSE {float(score):.2f}")


if __name__ == "__main__":
    main()
