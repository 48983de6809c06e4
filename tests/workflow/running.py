"""What the tests of the workflow share: running Snakemake in a copy of the project."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import yaml
from dry_runs import DryRuns

import warm_python
from expertaug.stages.evaluation import _WindowStudy
from expertaug.stages.planned import STUDIES as STAGE_OF

ROOT = Path(__file__).parents[2]
DATA = ["render_video", "extract_frames", "track_markers", "measure_angles", "plot_recording", "overlay", "recordings"]
DATA += ["split_chunks", "calibrate", "cut_measurements"]
LEARNING_TARGETS = ["train", "augment", "finetune", "during_training", "evaluate", "studies", "report"]
LEARNING_TARGETS += ["pendulum", "double_pendulum"]
TARGETS = [*DATA, "simulate", *LEARNING_TARGETS, "everything", "all"]
OPTIONS = ["--cores", "2"]
COMMAND = [sys.executable, "-m", "snakemake", *OPTIONS]
DRY_RUNS: dict[Path, DryRuns] = {}  # by project, of those with many
SMOKE = ["--configfile", "config/smoke.yaml", "studies.yaml"]
# Simulated and recorded data, the quick methods; each study and the comparison with the paper, on the pendulum.
STUDIES = """
run: [pendulum, double_pendulum]
experiments:
  pendulum:
    methods: [mean, expert_only, ml_only, aphynity, alternating]
    augmented: [aphynity]
    flows: [aphynity]
    refined: [aphynity+~flow]
    data: {sets: {near: {size: 9, z_e: {omega0: [1.5, 3.1]}, z_a: {alpha: [0.6, 1.0]}}}}
    augmentations: {narrow: null, wide: {prior: {omega0: [0.1, 7.0]}, methods: [aphynity]}}
    studies:
      out_of_expertise: {distances: [none, near], panels: {z_a shifted: [validation, near]}, overview: near}
      during_training: {method: aphynity, epochs: [1, 3], finetune_epochs: [1], max_samples: 9}
    evaluation: {published: pendulum}
  double_pendulum:
    methods: [mean, expert_only_point_mass, aphynity]
    augmented: [aphynity]
    controls: []
    refined: []
    studies: {during_training: null}
"""
WINDOW_STUDIES = [name for name, stage in STAGE_OF.items() if issubclass(stage, _WindowStudy)]
# The rules that a change redoes: all that follows its own.
EVALUATION = {"evaluate_seed_group", "tabulate_experiment", "plot_experiment", "plot_overview"}
EVALUATION |= {"log_evaluations_of_experiment", "write_report"}
# Of the studies of windows that of distances alone is of simulated systems only.
EVALUATION |= {f"{name}_of_experiment" for name in WINDOW_STUDIES if name != "distance"}
AUGMENTED = {"finetune_seed_group"} | EVALUATION
# Of the double pendulum longer forecasts and the loss of energy.
LEARNING = {"train_seed_group", "augment_seed_group", "horizons_of_experiment", "dissipation_of_experiment"} | AUGMENTED
LEARNING |= {"validity_of_experiment"}
CHUNKS = {"split_chunks_of_experiment", "plot_splits_of_experiment", "calibrate_experiment"} | LEARNING
CHUNKS |= {"cut_horizon_of_experiment"}
# Of the pendulum there is more.
COMPARED = {"compare_experiment", "compare_all"}
STUDIED = {"out_of_expertise_of_experiment", "prior_width_of_experiment"}
# The double pendulum's z_e say how a window begins: it has no estimates.
SCORED = STUDIED | {"distance_of_experiment", "estimates_of_experiment"} | COMPARED | EVALUATION
ALONG = {"during_training_of_experiment"}  # the study along training, which has scores of its own
TUNED = {"finetune_seed_group", "during_training_seed_group"} | ALONG | SCORED
TRAINED = {"train_seed_group", "augment_seed_group", "flow_seed_group", "validity_of_experiment"} | TUNED
ANGLES = {"measure_angles_of_recording", "plot_page_of_recording", "summarise_recordings"} | CHUNKS
MARKERS = {"extract_frames_of_recording", "track_markers_of_recording"} | ANGLES


def snakemake(project: Path, *arguments: object, warm: bool = True, **environment: str) -> subprocess.CompletedProcess:
    """Run Snakemake in the project with the package that lies there; it and its jobs start warm, or as a user's do."""
    python, path = (warm_python.interpreter(), {"PATH": warm_python.path()}) if warm else (sys.executable, {})
    return subprocess.run(
        [python, "-m", "snakemake", *OPTIONS, *map(str, arguments)],
        cwd=project,
        env=env_of(project) | path | environment,
        capture_output=True,
        text=True,
        timeout=900,
    )


def env_of(project: Path) -> dict[str, str]:
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return os.environ | {"PATH": path, "PYTHONPATH": str(project / "src"), "OMP_NUM_THREADS": "1"}


def planned(project: Path, *arguments: object, **environment: str) -> dict[str, int]:
    """Jobs that would be run, by rule; target rules left out."""
    options = ["--quiet", "host", "-n", *map(str, arguments)]
    if project in DRY_RUNS and not environment:
        done = DRY_RUNS[project].run([*OPTIONS, *options])
    else:
        done = snakemake(project, *options, **environment)
    assert done.returncode == 0, done.stdout + done.stderr
    table = (done.stdout + done.stderr).rpartition("Job stats:")[2].partition("total")[0]
    jobs = {rule: int(count) for rule, count in re.findall(r"^(\w+) +(\d+)$", table, re.MULTILINE)}
    return {rule: count for rule, count in jobs.items() if rule not in TARGETS}


def copy_project(folder: Path) -> Path:
    for name in ("src", "workflow", "config", "profiles"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
    for name in ("Snakefile", "constraints.txt", "pyproject.toml"):
        shutil.copy(ROOT / name, folder / name)
    (folder / "studies.yaml").write_text(STUDIES)
    return folder


def override(project: Path, change: dict) -> list[object]:
    """Command-line arguments that add ``change`` to the smoke configuration, in its results folder."""
    path = project / "change.yaml"
    path.write_text(yaml.safe_dump({"overwrite": True} | change))
    return [*SMOKE, path]


def kill_when_there(project: Path, arguments: list, checkpoint: Path) -> None:
    """Start Snakemake, and kill it with its jobs as soon as a checkpoint is written."""
    command = [*COMMAND, *map(str, arguments)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    running = subprocess.Popen(command, cwd=project, env=env_of(project), start_new_session=True, **quiet)
    try:
        until = time.monotonic() + 300
        while not checkpoint.exists():
            assert running.poll() is None and time.monotonic() < until, "no checkpoint"
            time.sleep(0.02)
    finally:
        os.killpg(running.pid, signal.SIGKILL)
        running.wait()
