"""Accuracy against what an estimate costs, of every version of an experiment's finished run.

    python benchmarks/window_costs.py config/config.yaml [FILE…] [--experiment pendulum] [--windows 100]

The files are those of the run, started in its folder.  Printed as a Markdown table: processor time in which one seed
estimates one validation window's parameters, all of these windows at once and on one core (``estimate_ms``), and the
validation log-MSE, mean over seeds.  A first call with two windows is not counted.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import torch

from expertaug.cli import keep_freed_memory
from expertaug.config import jobs, stage_settings
from expertaug.config import load as configuration
from expertaug.config.load import complete_configuration
from expertaug.evaluation.score import score
from expertaug.evaluation.settings import EvaluateJob
from expertaug.inference.flow import load
from expertaug.inference.least_squares import refine_by, refinement_of
from expertaug.trajectories import Trajectories


def main() -> None:
    """Print a row a version that the run has trained."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--experiment", default="pendulum")
    parser.add_argument("--windows", type=int, default=100)
    options = parser.parse_args()
    keep_freed_memory()
    torch.set_num_threads(1)
    config = complete_configuration(configuration.load(options.files))
    device, folder = torch.device("cpu"), Path(config.results) / options.experiment
    windows = Trajectories.load(folder / "data" / "validation.npz").spread(options.windows)
    print("| method | estimate [ms] | log-MSE (validation) |\n|---|---:|---:|")
    for variant in jobs.variants(config, options.experiment):
        model = next(iter(sorted((folder / variant.replace("~refined", "")).glob("*/model.safetensors"))), None)
        if model is None:
            continue
        job = EvaluateJob.from_mapping(stage_settings.evaluate(config, options.experiment, variant, model.parent.name))
        stored = load(model, device, job.classes or ())
        refinement = refinement_of(stored, job.refinement)
        if refinement is not None:
            stored = replace(stored, model=refine_by(stored, refinement))
        for data in (windows.spread(2), windows):
            values = score(stored, data, job.evaluation.without_draws, job.choices.forecast_start, device).values
        cost = f"{values['estimate_ms'].mean():.3g}" if "estimate_ms" in values else "–"
        print(f"| {job.label} | {cost} | {values['log_mse_sum'].mean():.2f} |", flush=True)


if __name__ == "__main__":
    main()
