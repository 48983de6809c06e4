"""How often ``expertaug.compare`` finds the right one of three pendulums: ``python benchmarks/compare_experts.py``.

Each set is simulated by one of the experts, with 6 to 30 windows of 2 to 6 s, noise between .005 and .1 rad and, of the
damped pendulum, a friction between .03 and .6 1/s.  Prints a line for each set that is not decided as it was made, and
the counts (five minutes for 100 sets).
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np
import torch
from torch import Tensor

import expertaug as ea


class Damped(ea.DampedPendulum):
    """θ'' = −ω0² sin θ − α θ', both known to the expert."""

    expert_parameters = (*ea.DampedPendulum.expert_parameters, ea.Parameter("alpha", "1/s", scale=0.3))

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor) -> Tensor:
        drag = z_e[..., 1] * y[..., 1]
        return super().expert(t, y, z_e[..., :1]) - torch.stack((torch.zeros_like(drag), drag), dim=-1)


class Linear(ea.DampedPendulum):
    """θ'' = −ω0² θ."""

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor) -> Tensor:
        return torch.cat((y[..., 1:], -z_e.square() * y[..., :1]), dim=-1)


FREQUENCY, FRICTION = (1.0, 3.5), (0.01, 1.0)
EXPERTS = {"free": ea.DampedPendulum(), "damped": Damped(), "linear": Linear()}
PRIORS = {"free": {"omega0": FREQUENCY}, "linear": {"omega0": FREQUENCY}}
PRIORS["damped"] = {"omega0": FREQUENCY, "alpha": FRICTION}


def main() -> None:
    """Print what was not decided rightly, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=100)
    options = parser.parse_args()
    torch.set_num_threads(1)
    random, counts = np.random.default_rng(0), Counter()
    for k in range(options.sets):
        truth = tuple(EXPERTS)[k % len(EXPERTS)]
        n, noise = int(random.integers(6, 31)), float(10 ** random.uniform(-2.3, -1))
        t = np.arange(int(random.integers(21, 61))) * 0.1
        alpha = float(random.uniform(0.03, 0.6)) if truth == "damped" else 0.0
        maker = EXPERTS["linear"] if truth == "linear" else ea.DampedPendulum()
        data = ea.simulate(
            maker, {"omega0": (1.2, 3.1)}, {"alpha": (alpha, alpha)}, n=n, t=t, noise=noise, seed=1000 + k
        )
        found = ea.compare(EXPERTS, data, observed_s=float(t[-1]), noise=noise, priors=PRIORS, starts=12, tries=3)
        verdict = "right" if found.chosen == truth else "undecided" if found.chosen is None else "wrong"
        counts[verdict] += 1
        counts["the right one explains"] += found.choice.goodness[truth].explains
        if verdict != "right":
            print(f"set {k}: {truth}, n = {n}, noise = {noise:.3g}, {t[-1]:.1f} s, alpha = {alpha:.2f}: {found.says}")
    print(", ".join(f"{name} {count}" for name, count in counts.items()))


if __name__ == "__main__":
    main()
