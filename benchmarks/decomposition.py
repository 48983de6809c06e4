"""What F_a of a trained pendulum model is made of: ``python benchmarks/decomposition.py [RESULTS]``.

Along the forecasts of the validation set, over the observed window, F_a is split by least squares: its part of dθ/dt
into −β θ, its part of dθ'/dt into −γ θ' − κ sin θ.  The truth is β = κ = 0, γ = α; the data fix β + γ = α alone.
The multiples of α, and ω0² − z_e² at the largest α, are of lines fitted over α.  A second line has the mean friction
β + γ of the sixth of the samples with the least α and of that with the most: of an encoder that cannot read α they are
the same.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch

from expertaug.models import store
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows


def slopes(parts: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Least-squares coefficients (…, K) of rates (…, T) on parts (…, T, K)."""
    return np.einsum("...kt,...t->...k", np.linalg.pinv(parts), rates)


@torch.no_grad()
def main() -> None:
    """Print a line a seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="?", default=Path("results"))
    parser.add_argument("--experiment", default="pendulum")
    options = parser.parse_args()
    folder = options.results / options.experiment
    torch.set_num_threads(1)
    truth = Trajectories.load(folder / "data" / "validation.npz")
    alpha, squared = truth.z_a[:, 0], truth.z_e[:, 0] ** 2
    least, *_, most = np.array_split(np.argsort(alpha), 6)
    for file in sorted((folder / "aphynity").glob("*/model.safetensors")):
        stored = store.load(file)
        points = stored.card.observed
        windows = Windows.of(truth).until(points).expand(len(stored.seeds))
        z_e, z_a = stored.model.encode(windows).mean
        states = stored.model.forecast(windows.y[0], z_e, z_a, windows.t, Solver("rk4"))
        context = stored.model.interaction.context(z_a, z_e)
        rates = torch.stack([stored.model.interaction(state, context) for state in states]).permute(1, 2, 0, 3).numpy()
        theta, speed = states.permute(1, 2, 3, 0).unbind(2)
        beta = -slopes(theta.unsqueeze(-1).numpy(), rates[..., 0])[..., 0]
        gamma, kappa = -np.moveaxis(slopes(torch.stack((speed, theta.sin()), -1).numpy(), rates[..., 1]), -1, 0)
        for seed, b, g, k, z in zip(stored.seeds, beta, gamma, kappa, z_e[..., 0].numpy(), strict=True):
            of_alpha = [np.polyfit(alpha, x, 1)[0] for x in (b, g, b + g)]
            print(
                f"seed {seed}: β {of_alpha[0]:.2f} α, γ {of_alpha[1]:.2f} α, β + γ {of_alpha[2]:.2f} α; "
                f"κ {100 * np.median(k / squared):.1f} % of ω0², z_e² {100 * np.median(z**2 / squared - 1):+.1f} %, "
                f"ω0² − z_e² at the largest α {np.polyval(np.polyfit(alpha, squared - z**2, 1), alpha.max()):.2f}\n"
                f"  β + γ {(b + g)[least].mean():.2f} where α is {alpha[least].mean():.2f}, "
                f"{(b + g)[most].mean():.2f} where α is {alpha[most].mean():.2f}"
            )


if __name__ == "__main__":
    main()
