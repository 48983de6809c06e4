"""What starts are worth when a trained model's estimates are refined, on the validation set or another.

    python benchmarks/refinement_starts.py config/config.yaml [FILE…] [--experiment double_pendulum]
        [--method aphynity] [--set validation] [--windows 150] [--settings 0,1,15 64,1,30 256,3,30]

The files are those of a finished run, started in this folder.  A setting is
starts,tries,steps[,sufficient[,agreement]]: points of p⁺ at which each window is compared with the model, the best of
them from which a fit starts beside the model's own estimate, Levenberg–Marquardt steps at most, the quantile of χ² up
to which the fit from the model's own estimate is enough, and how near a further minimum must be to the lowest to end
the search.  Printed for each: log-MSE of every seed, per dimension, of the mean and of the median over windows, and
processor time.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import torch

from expertaug.cli import keep_freed_memory
from expertaug.config import load as configuration
from expertaug.config import stage_settings
from expertaug.config.load import complete_configuration
from expertaug.evaluation.score import score
from expertaug.evaluation.settings import EvaluateJob
from expertaug.inference.flow import load
from expertaug.inference.least_squares import refine_by
from expertaug.trajectories import Trajectories


def main() -> None:
    """Print a line a setting."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--experiment", default="double_pendulum")
    parser.add_argument("--method", default="aphynity")
    parser.add_argument("--set", default="validation")
    parser.add_argument("--windows", type=int, default=150)
    parser.add_argument("--settings", nargs="+", default=["0,1,15", "64,1,30", "256,3,30"])
    options = parser.parse_args()
    keep_freed_memory()
    torch.set_num_threads(1)
    config = complete_configuration(configuration.load(options.files))
    device, folder = torch.device("cpu"), Path(config.results) / options.experiment
    model = sorted((folder / options.method).glob("*/model.safetensors"))[0]
    version = f"{options.method}~refined"
    job = EvaluateJob.from_mapping(stage_settings.evaluate(config, options.experiment, version, model.parent.name))
    assert job.refinement is not None
    stored = load(model, device)
    windows = Trajectories.load(folder / "data" / f"{options.set}.npz").spread(options.windows)
    for text in options.settings:
        names = ("starts", "tries", "steps", "sufficient", "agreement")
        given = [float(value) if "." in value else int(value) for value in text.split(",")]
        how = job.refinement.settings.model_copy(update=dict(zip(names, given, strict=False)))
        before = time.process_time()
        refined = replace(stored, model=refine_by(stored, job.refinement.model_copy(update={"settings": how})))
        values = score(refined, windows, job.evaluation.without_draws, job.choices.forecast_start, device).values
        taken = time.process_time() - before
        mean, median = (values[f"log_mse{kind}_dim"].tolist() for kind in ("", "_median"))
        found = [" ".join(f"{value:.2f}" for value in each) for each in (mean, median)]
        print(f"{text}: mean {found[0]}, median {found[1]}, {taken:.1f} CPU-s", flush=True)


if __name__ == "__main__":
    main()
