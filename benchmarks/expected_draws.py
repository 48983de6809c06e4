"""How many draws the error to be expected needs, on windows of the model's own making, which no test set is.

    python benchmarks/expected_draws.py config/config.yaml [FILE…] [--experiment pendulum]
        [--versions hvae hvae+ aphynity~refined] [--windows 300] [--draws 1 2 4 8 16]

The files are those of a run that has trained these versions, started in its folder.  Each seed's model makes windows
over p⁺; a forecast fails whose squared error is above the 99 % quantile of the validation set's.  Printed for each
version: the share that fails, and the AUROC of the expected error by the number of draws, means over seeds.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from expertaug.cli import keep_freed_memory
from expertaug.config import load as configuration
from expertaug.config import stage_settings
from expertaug.config.load import complete_configuration
from expertaug.evaluation.forecasting import ExpectedError, drawing_of, forecast
from expertaug.evaluation.score import score
from expertaug.evaluation.settings import EvaluateJob
from expertaug.inference.diagnostics.alarm import auroc, failing
from expertaug.inference.flow import load
from expertaug.inference.least_squares import refine_by
from expertaug.inference.simulations import draw_simulations
from expertaug.learning.divergence import bound_of_card
from expertaug.learning.residuals import squared_errors
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows


@torch.no_grad()
def main() -> None:
    """Print a line a version."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--experiment", default="pendulum")
    parser.add_argument("--versions", nargs="+", default=["hvae", "hvae+", "aphynity~refined"])
    parser.add_argument("--windows", type=int, default=300)
    parser.add_argument("--draws", type=int, nargs="+", default=[1, 2, 4, 8, 16])
    options = parser.parse_args()
    keep_freed_memory()
    torch.set_num_threads(1)
    config, device = complete_configuration(configuration.load(options.files)), torch.device("cpu")
    folder = Path(config.results) / options.experiment
    train, validation = (Trajectories.load(folder / "data" / f"{name}.npz") for name in ("train", "validation"))
    print("version: failing [%], AUROC of", ", ".join(map(str, options.draws)), "draws")
    for version in options.versions:
        model = sorted((folder / version.removesuffix("~refined")).glob("*/model.safetensors"))[0]
        job = EvaluateJob.from_mapping(stage_settings.evaluate(config, options.experiment, version, model.parent.name))
        start, how = job.choices.forecast_start, job.evaluation.without_draws
        stored = load(model, device)
        if job.refinement is not None:
            stored = replace(stored, model=refine_by(stored, job.refinement))
        usual = score(stored, validation, how, start, device).errors.numpy()
        windows, _ = draw_simulations(stored, Windows.of(train, device), job.own, job.noise, options.windows)
        drawing, bound = drawing_of(stored, how, job.noise, train.t, start, device), bound_of_card(stored.card, device)
        made = forecast(stored.model, windows.observed(drawing.observed), drawing.solver, start, bound)
        errors = squared_errors(stored.model.system, made.states[drawing.begin :], windows.y[drawing.begin :]).numpy()
        bad = np.stack([failing(one, of_set) for one, of_set in zip(errors, usual, strict=True)])
        areas = []
        for count in options.draws:
            expected = ExpectedError(stored.model, replace(drawing, count=count))
            expected.add(made, windows, bound)
            scores = expected.joined()[0].numpy()
            areas.append(np.mean([auroc(one, of_seed).value for one, of_seed in zip(scores, bad, strict=True)]))
        print(f"{version}: {100 * bad.mean():.1f}, {' '.join(f'{area:.3f}' for area in areas)}", flush=True)


if __name__ == "__main__":
    main()
