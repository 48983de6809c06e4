"""What a stopped run has left: files that are missing are made again, a killed training goes on to the same bits."""

from __future__ import annotations

import json
import re
import shutil

import pytest
import torch
from running import ALONG, ANGLES, MARKERS, SCORED, SMOKE, copy_project, kill_when_there, override, planned, snakemake
from safetensors.torch import load_file

BASES = {"train_seed_group"}
TUNING = {"augment_seed_group", "finetune_seed_group"}
EVALUATED = {"evaluate_seed_group", "log_evaluations_of_experiment"}
MEASURED = {"measure_angles_of_recording", "split_chunks_of_experiment", "calibrate_experiment"}


# A file of each stage, a target, and what that target redoes when the file is missing.
MISSING = [
    ("recordings/*/video.mp4", "track_markers", {"render_video_of_recording"} | MARKERS - ANGLES),
    ("recordings/*/markers.csv", "calibrate", (MARKERS - ANGLES) | MEASURED),
    ("recordings/*/angles.csv", "calibrate", MEASURED),
    ("double_pendulum/data/train.npz", "calibrate", MEASURED - {"measure_angles_of_recording"}),
    ("double_pendulum/data/calibration.json", "train", {"calibrate_experiment", "train_seed_group"}),
    ("pendulum/data/train.npz", "train", {"simulate_set"} | BASES),
    ("pendulum/data/near.npz", "evaluate", {"simulate_set"} | EVALUATED),
    ("pendulum/aphynity/*/model.safetensors", "augment", {"train_seed_group", "augment_seed_group"}),
    ("pendulum/aphynity/*/model.safetensors", "finetune", {"train_seed_group"} | TUNING),
    (
        "pendulum/aphynity/*/snapshots.safetensors",
        "during_training",
        {"train_seed_group", "during_training_seed_group"},
    ),
    ("pendulum/aphynity+/*/augmented.safetensors", "finetune", TUNING),
    ("pendulum/aphynity+wide/*/model.safetensors", "evaluate", {"finetune_seed_group"} | EVALUATED),
    ("pendulum/evaluations.json", "evaluate", {"log_evaluations_of_experiment"}),
    ("pendulum/aphynity+wide/*/metrics.csv", "studies", {"evaluate_seed_group", "prior_width_of_experiment"}),
    ("pendulum/aphynity/*/during_training.csv", "studies", {"during_training_seed_group"} | ALONG),
    (
        "pendulum/ml_only/*/model.safetensors",
        "pendulum",
        {"train_seed_group"}
        | SCORED
        - {"prior_width_of_experiment", "estimates_of_experiment", "plot_overview", "compare_all", "write_report"},
    ),
]


@pytest.mark.parametrize(("file", "target", "rules"), MISSING)
def test_what_a_stopped_job_has_left_missing_is_made_again(project, file, target, rules):
    found = next((project / "results" / "smoke").glob(file))
    aside = found.rename(project / "aside")
    try:
        assert set(planned(project, target, *SMOKE)) == rules
    finally:
        aside.rename(found)


def test_the_default_target_asks_for_every_file_on_the_way(project):
    """Only what a target asks for by name is made again when it is missing; one file of each stage stands for all."""
    said = snakemake(project, "--dry-run", "--forcerun", "everything", *SMOKE)
    asked = re.search(r"rule everything:\n +input: (.*)", said.stdout + said.stderr)[1].split(", ")
    for pattern, *_ in MISSING:
        found = {path.relative_to(project).as_posix() for path in (project / "results" / "smoke").glob(pattern)}
        assert found and found <= set(asked), pattern


def test_a_missing_file_is_made_again_by_the_default_target(project):
    found = project / "results/smoke/pendulum/aphynity+wide/seeds_0_1/augmented.safetensors"
    aside = found.rename(project / "aside")
    try:
        assert set(planned(project, *SMOKE)) >= {"augment_seed_group", "finetune_seed_group", "evaluate_seed_group"}
    finally:
        aside.rename(found)


@pytest.mark.slow
def test_a_killed_training_resumes_to_the_same_bits(tmp_path):
    project = copy_project(tmp_path / "project")
    model, tensors = "pendulum/aphynity/seeds_0_1/model.safetensors", {}
    training = {"epochs": 40, "checkpoint_s": 0.0}
    for name in ("whole", "killed"):
        change = {"experiments": {"pendulum": {"training": training}}, "tracking": {"enabled": False}}
        arguments = [f"results/{name}/{model}", *override(project, change | {"results": f"results/{name}"})]
        if name == "killed":
            data = "results/{}/pendulum/data"  # the same for both
            shutil.copytree(project / data.format("whole"), project / data.format("killed"))
            checkpoint = project / "results/killed/.work/pendulum/aphynity/seeds_0_1/checkpoint.pt"
            kill_when_there(project, arguments, checkpoint)
            log = project / f"results/{name}/pendulum/aphynity/seeds_0_1/log.jsonl"
            identity = json.loads(log.read_text().partition("\n")[0])["id"]
            assert not (project / "results" / name / model).exists()
            assert snakemake(project, "--unlock", *arguments).returncode == 0
        done = snakemake(project, *arguments)
        assert done.returncode == 0, done.stderr
        tensors[name] = load_file(project / "results" / name / model)
    assert json.loads(log.read_text().partition("\n")[0])["id"] == identity, "the training began again"
    assert tensors["whole"].keys() == tensors["killed"].keys()
    assert all(torch.equal(tensors["whole"][key], tensors["killed"][key]) for key in tensors["whole"])


def test_what_a_kill_has_deleted_is_made_again_when_the_change_is_taken_back(smoke_run, tmp_path):
    project = shutil.copytree(smoke_run, tmp_path / "project")
    results = project / "results" / "smoke"
    change = {"experiments": {"pendulum": {"training": {"epochs": 400, "checkpoint_s": 0.0}}}}
    model = "pendulum/aphynity/seeds_0_1/model.safetensors"
    arguments = [f"results/smoke/{model}", *override(project, change)]
    kill_when_there(project, arguments, results / ".work/pendulum/aphynity/seeds_0_1/checkpoint.pt")
    assert not (results / model).exists() and (results / "pendulum/aphynity/seeds_0_1/metrics.csv").exists()
    assert snakemake(project, "--unlock", *SMOKE).returncode == 0
    assert "train_seed_group" in planned(project, *SMOKE)
    assert "train_seed_group" in planned(project, "finetune", *SMOKE)
