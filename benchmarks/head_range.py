"""What the z_e head of a recurrent encoder can give: ``python benchmarks/head_range.py [RESULTS] [--experiment NAME]``.

A GRU's state lies in (−1, 1).  Where fine-tuning leaves the head alone (``choices.frozen: interaction_and_z_e_head``),
z_e cannot leave the range of the trained head over that cube, whatever the GRU learns.  Printed for every seed and
parameter: the lowest and the highest value that a gradient search over the cube finds from 64 random states.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from torch import Tensor

from expertaug.models import store
from expertaug.models.encoders.recurrent import RecurrentEncoder
from expertaug.models.posterior import constrain

STARTS, STEPS, RATE = 64, 500, 0.05


def extreme(encoder: RecurrentEncoder, seeds: int, parameter: int, sign: float) -> Tensor:
    """Lowest (sign 1) or highest (sign −1) value (S,) of a parameter that was found."""
    inside = torch.empty(seeds, STARTS, encoder.latent).uniform_(-3, 3, generator=torch.Generator().manual_seed(0))
    inside.requires_grad_()
    optimiser, best = torch.optim.Adam([inside], lr=RATE), torch.full((seeds,), torch.inf)
    for _ in range(STEPS):
        value = sign * constrain(encoder.head(torch.tanh(inside)), encoder.system.expert_parameters)[..., parameter]
        best = torch.minimum(best, value.detach().amin(1))
        optimiser.zero_grad()
        value.sum().backward()
        optimiser.step()
    return sign * best


def main() -> None:
    """Print a line a seed and parameter."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="?", default=Path("results/code"))
    parser.add_argument("--experiment", default="pendulum")
    options = parser.parse_args()
    torch.set_num_threads(1)
    for file in sorted((options.results / options.experiment / "aphynity").glob("*/model.safetensors")):
        stored = store.load(file, torch.device("cpu"))
        for index, parameter in enumerate(stored.model.system.expert_parameters):
            ends = [extreme(stored.model.encoder, len(stored.seeds), index, sign) for sign in (1.0, -1.0)]
            for seed, low, high in zip(stored.seeds, *ends, strict=True):
                print(f"seed {seed}: {parameter.name} from {low:.2f} to {high:.2f} {parameter.unit}")


if __name__ == "__main__":
    main()
