"""Are standard errors of shared parameters as large as the errors?  ``python benchmarks/shared_errors.py`` (a minute).

Sets of windows of one damped pendulum, 2 s each with noise .02, are fitted with both parameters shared.  Prints, for a
number of windows, the standard deviation over sets of (estimate − truth) / standard error: 1 where errors are right.
"""

from __future__ import annotations

import argparse

import numpy as np
import torch

import expertaug as ea
from compare_experts import FRICTION, Damped

OMEGA0, ALPHA, NOISE = 1.7, 0.15, 0.02


def main() -> None:
    """Print a line for each number of windows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=40)
    parser.add_argument("--windows", type=int, nargs="*", default=[10, 20, 40])
    options = parser.parse_args()
    torch.set_num_threads(1)
    prior, units = {"omega0": (1.0, 3.0), "alpha": FRICTION}, {"omega0": "shared", "alpha": "shared"}
    for count in options.windows:
        scores = []
        for seed in range(options.sets):
            one = {"z_e": {"omega0": (OMEGA0, OMEGA0)}, "z_a": {"alpha": (ALPHA, ALPHA)}}
            data = ea.simulate(ea.DampedPendulum(), **one, n=count, t=np.arange(21) * 0.1, noise=NOISE, seed=seed)
            model = ea.least_squares(Damped(), data, observed_s=2.0, prior=prior, noise=NOISE, units=units)
            estimate = model.forecast(data.y, data.t)
            pairs = (("omega0", OMEGA0), ("alpha", ALPHA))
            scores.append([(estimate.z_e[k][0] - true) / estimate.z_e_std[k][0] for k, true in pairs])
        spread = np.std(scores, axis=0)
        print(f"{count} windows: omega0 {spread[0]:.2f}, alpha {spread[1]:.2f}")


if __name__ == "__main__":
    main()
