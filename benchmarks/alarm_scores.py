"""Which score tells failing forecasts: the alarm study of chosen versions and their refined ones, on fewer windows.

    python benchmarks/alarm_scores.py config/config.yaml [FILE…] [--experiment pendulum] [--methods aphynity aphynity+]
        [--windows 300] [--draws 8]

The files are those of a run that has trained these versions, started in its folder.  Printed is the study's table: each
version is evaluated as it is and refined, on so many windows of each set, with at most so many draws of a posterior.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch

from expertaug.cli import keep_freed_memory
from expertaug.config import load as configuration
from expertaug.config import report_parameters, stage_settings
from expertaug.config.load import complete_configuration
from expertaug.evaluation.alarms import alarm
from expertaug.evaluation.evaluate import evaluate
from expertaug.evaluation.settings import EvaluateJob, WindowStudyJob
from expertaug.inference.flow import load
from expertaug.models.store import device_of
from expertaug.trajectories import SetFolder


def main() -> None:
    """Evaluate, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--experiment", default="pendulum")
    parser.add_argument("--methods", nargs="+", default=["aphynity", "aphynity+"])
    parser.add_argument("--windows", type=int, default=300)
    parser.add_argument("--draws", type=int, default=8)
    options = parser.parse_args()
    keep_freed_memory()
    torch.set_num_threads(1)
    config = complete_configuration(configuration.load(options.files))
    folder = Path(config.results) / options.experiment
    made, sets = [], SetFolder(folder / "data")
    for method in options.methods:
        for version in (method, f"{method}~refined"):
            for model in sorted((folder / method).glob("*/model.safetensors")):
                settings = stage_settings.evaluate(config, options.experiment, version, model.parent.name)
                fewer = {"max_samples": options.windows, "draws": options.draws, "drawn_samples": 1, "samples": 1}
                fewer["expected_draws"] = options.draws
                job = EvaluateJob.from_mapping(settings | {"evaluation": settings["evaluation"] | fewer})
                stored = load(model, device_of(job.device), job.classes or ())
                made.append(evaluate(stored, sets, job).forecasts)
    study = alarm(made, WindowStudyJob.from_mapping(report_parameters.windows(config, options.experiment)))
    print(study.markdown())


if __name__ == "__main__":
    main()
