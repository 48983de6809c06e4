"""What a job costs beside its work: `python benchmarks/job_costs.py`.

Processor time of each short stage of the pendulum in config/smoke.yaml, whose work itself takes next to nothing: the
least of several runs, each a process of its own, started by itself and warm, as a run of the workflow starts it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from expertaug.config import load as config
from expertaug.config.load import complete_configuration
from expertaug.evaluation import costs
from expertaug.runs.warm import WORTH_IT, warm_jobs
from expertaug.stages import STAGES

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


def warm_seconds(folder: Path, *arguments: object) -> float:
    """The same of a job that starts warm, without the process that forks it; 0 where the system has no such forks."""
    if not warm_jobs(WORTH_IT, "expertaug.cli"):
        return 0.0
    environment, log = os.environ | {"OMP_NUM_THREADS": "1"}, folder / "logs" / "job.log"
    command = ["expertaug", *map(str, arguments), "--log", str(log)]
    found = []
    for _ in range(RUNS):
        subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True)
        found.append(costs.of_run(log.parent)["job"].cpu_seconds)
    return min(found)


def main() -> None:
    """Print the cost of each stage."""
    root = Path(__file__).parents[1]
    of_run = complete_configuration(config.load([root / "config/config.yaml", root / "config/smoke.yaml"]))

    def text(stage: str, *names: str) -> str:
        return f"--settings={STAGES[stage].settings_of(of_run, *names)}"

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        store = json.dumps({"enabled": True, "uri": "sqlite:///mlflow.db", "experiment": "e"})
        stages: dict[str, list[object]] = {
            "init-tracking": [
                "--output=tracking.json",
                f"--settings={store}",
            ],
            **{
                f"simulate {name}": ["--output", f"{name}.npz", text("simulate", EXPERIMENT, name)]
                for name in of_run.experiments[EXPERIMENT].data.set_names
            },
            "train": ["--data=.", "--output=m.safetensors", "--work=work", text("train", EXPERIMENT, METHOD, GROUP)],
            "train, stored": ["--data=.", "--output=m.safetensors", "--work=work", "--tracking=tracking.json"],
            "augment": ["--model=m.safetensors", "--data=.", "--output=a.safetensors"],
            "evaluate": ["--model=m.safetensors", "--data=.", "--output=metrics.csv", "--forecasts=f.npz"],
            "log-evaluations": ["f.npz", "--output=e.json", "--tracking=tracking.json"],
            "tabulate": ["metrics.csv", "--forecasts=f.npz", "--output", "long.csv", "t.md"],
        }
        stages["train, stored"].append(text("train", EXPERIMENT, METHOD, GROUP))
        stages["augment"].append(text("augment", EXPERIMENT, f"{METHOD}+", GROUP))
        stages["tabulate"].append(text("tabulate", EXPERIMENT))
        stages["evaluate"].append(text("evaluate", EXPERIMENT, METHOD, GROUP))
        for name, arguments in stages.items():
            words = [*name.partition(",")[0].split(), *arguments]
            print(f"{name:22} {seconds(folder, *words):5.1f} s, warm {warm_seconds(folder, *words):5.1f} s", flush=True)


if __name__ == "__main__":
    main()
