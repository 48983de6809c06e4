"""What a job costs beside its work: `python benchmarks/job_costs.py`.

Processor time of each short stage of the pendulum in config/smoke.yaml, whose work itself takes next to nothing: the
least of several runs, each a process of its own as in the workflow.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from expertaug.config import load as config
from expertaug.config import stage_settings as settings
from expertaug.config.load import completed

RUNS = 3
EXPERIMENT, METHOD, GROUP = "pendulum", "aphynity", "seeds_0_1"


def seconds(folder: Path, *arguments: object) -> float:
    """Processor time, user and system, of ``expertaug`` with these arguments: the least of several runs."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    found = []
    for _ in range(RUNS):
        before = os.times()
        command = [sys.executable, "-m", "expertaug.cli", *map(str, arguments)]
        subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True)
        after = os.times()
        found.append(after.children_user + after.children_system - before.children_user - before.children_system)
    return min(found)


def main() -> None:
    """Print the cost of each stage."""
    root = Path(__file__).parents[1]
    of_run = completed(config.load([root / "config/config.yaml", root / "config/smoke.yaml"]))
    one = (of_run, EXPERIMENT, METHOD, GROUP)

    def text(stage: str, *given: object) -> str:
        return f"--settings={json.dumps(getattr(settings, stage)(*given))}"

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        store = json.dumps({"enabled": True, "uri": "sqlite:///mlflow.db", "experiment": "e"})
        stages: dict[str, list[object]] = {
            "init-tracking": ["--output=tracking.json", f"--settings={store}"],
            **{
                f"simulate {name}": ["--output", f"{name}.npz", text("simulate", of_run, EXPERIMENT, name)]
                for name in settings.evaluate(*one)["sets"]
            },
            "train": ["--data=.", "--output=m.safetensors", "--work=work", text("train", *one)],
            "train, stored": ["--data=.", "--output=m.safetensors", "--work=work", "--tracking=tracking.json"],
            "augment": ["--model=m.safetensors", "--data=.", "--output=a.safetensors"],
            "evaluate": ["--model=m.safetensors", "--data=.", "--output=metrics.csv", "--forecasts=f.npz"],
            "log-evaluations": ["f.npz", "--output=e.json", "--tracking=tracking.json"],
            "tabulate": ["metrics.csv", "--forecasts=f.npz", "--output=t.md", text("tabulate", of_run, EXPERIMENT)],
        }
        stages["train, stored"].append(text("train", *one))
        stages["augment"].append(text("augment", of_run, EXPERIMENT, f"{METHOD}+", GROUP))
        stages["evaluate"].append(text("evaluate", *one))
        for name, arguments in stages.items():
            print(f"{name:22} {seconds(folder, *name.partition(',')[0].split(), *arguments):5.1f} s", flush=True)


if __name__ == "__main__":
    main()
