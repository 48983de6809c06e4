"""How well an encoder does, before and after fine-tuning, where augmentation sends it, without a test set.

    python benchmarks/own_samples.py [RESULTS] [--experiment pendulum] [--method aphynity]
        [--prior '{"omega0": [0.5, 1.5]}']

The trained model simulates one sample for each of the training set, its z_e drawn from the given ranges; it and the
model fine-tuned from it forecast them from their noisy observed windows.  Both have the same F_a, so that what is lost
is the encoder's.  Printed for each of them and each seed: log-MSE over (t1, t2], summed over the state, as a mean and a
median over the samples (few bad ones make the difference), and the mean relative error of z_e.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import torch

from expertaug.learning import augment as augmentation
from expertaug.learning.training_data import StackedSet, task_of
from expertaug.models import store
from expertaug.trajectories import Trajectories

DRAW = 10**6  # far from the draws of any training


@torch.no_grad()
def main() -> None:
    """Print a line a seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="?", default=Path("results"))
    parser.add_argument("--experiment", default="pendulum")
    parser.add_argument("--method", default="aphynity")
    parser.add_argument("--prior", type=json.loads, default={"omega0": [0.5, 1.5]})
    options = parser.parse_args()
    folder, cpu = options.results / options.experiment, torch.device("cpu")
    torch.set_num_threads(1)
    data = StackedSet.of(Trajectories.load(folder / "data" / "train.npz"), cpu)
    for file in sorted((folder / options.method).glob("*/model.safetensors")):
        tuned_file = folder / f"{options.method}+" / file.parent.name / file.name
        base, tuned = store.load(file, cpu), store.load(tuned_file, cpu)
        path, t = tuned_file.with_name("augmented.safetensors"), torch.tensor(base.card.t)
        drawing = augmentation.load(path, cpu, t).drawing
        task = task_of(base.card.training, base.card, cpu)
        drawing = replace(drawing, prior=options.prior)
        samples = augmentation.generate(base.model, data, task, drawing, DRAW)
        for label, stored in ((base.card.label, base), (tuned.card.label, tuned)):
            z_e, z_a = stored.model.encode(samples.windows(task.observed)).mean
            forecast = stored.model.forecast(samples.y[0], z_e, z_a, task.t, task.solver)
            error = (forecast - samples.y).square().flatten(3).sum(-1)[task.observed :].mean(0)
            relative = ((z_e - samples.z_e) / samples.z_e).abs().mean((1, 2))
            rows = zip(base.seeds, error.mean(1).log(), error.median(1).values.log(), relative, strict=True)
            for seed, mean, median, wrong in rows:
                found = f"log-MSE {mean:.2f} (of the median {median:.2f}), z_e off by {100 * wrong:.1f} %"
                print(f"{label}, seed {seed}: {found}")


if __name__ == "__main__":
    main()
