"""The workflow as a whole: one smoke run from an empty folder, and what is redone after a change.

The run is shared; the tests after it only ask what would be done, or put back what they change.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
import yaml
from safetensors.torch import load_file

from expertaug import source_files
from expertaug.config import load as config
from expertaug.config import stage_code, stage_settings

ROOT = Path(__file__).parents[2]
DATA = ["render_video", "extract_frames", "track_markers", "measure_angles", "plot_recording", "overlay", "recordings"]
DATA += ["split_chunks", "calibrate"]
LEARNING_TARGETS = ["train", "augment", "finetune", "during_training", "evaluate", "studies", "report"]
LEARNING_TARGETS += ["pendulum", "double_pendulum"]
TARGETS = [*DATA, "simulate", *LEARNING_TARGETS, "everything", "all"]
SMOKE = ["--configfile", "config/smoke.yaml", "studies.yaml"]
# Simulated and recorded data, the quick methods; each study and the comparison with the paper, on the pendulum.
STUDIES = """
run: [pendulum, double_pendulum]
experiments:
  pendulum:
    methods: [mean, expert_only, ml_only, aphynity]
    augmented: [aphynity]
    data: {sets: {near: {size: 9, z_e: {omega0: [1.5, 3.1]}, z_a: {alpha: [0.6, 1.0]}}}}
    augmentations: {narrow: null, wide: {prior: {omega0: [0.1, 7.0]}, methods: [aphynity]}}
    studies:
      out_of_expertise: {distances: [none, near], panels: {z_a shifted: [validation, near]}, overview: near}
      during_training: {method: aphynity, epochs: [1, 3], finetune_epochs: [1], max_samples: 9}
    evaluation: {published: pendulum}
  double_pendulum:
    methods: [mean, expert_only_point_mass, expert_only, ml_only, aphynity]
    augmented: [aphynity]
    studies: {during_training: null}
"""
EVALUATION = {"evaluate_seed_group", "tabulate_experiment", "plot_experiment", "plot_overview"}
AUGMENTED = {"finetune_seed_group"} | EVALUATION
LEARNING = {"train_seed_group", "augment_seed_group"} | AUGMENTED
CHUNKS = {"split_chunks_of_experiment", "plot_splits_of_experiment", "calibrate_experiment"} | LEARNING
# Of the pendulum there is more.
SCORED = {"study_experiment", "compare_experiment", "compare_all"} | EVALUATION
TUNED = {"finetune_seed_group", "during_training_seed_group"} | SCORED
TRAINED = {"train_seed_group", "train_seed_group_with_snapshots", "augment_seed_group"} | TUNED
ANGLES = {"measure_angles_of_recording", "plot_page_of_recording", "summarise_recordings"} | CHUNKS
MARKERS = {"extract_frames_of_recording", "track_markers_of_recording"} | ANGLES

# Written into the environment of the smoke run: each job of the command line says which modules it has loaded.
RECORDER = """
import atexit, json, os, sys, uuid
def record():
    files = [getattr(m, "__file__", None) for n, m in list(sys.modules.items()) if n.partition(".")[0] == "expertaug"]
    if os.path.basename(sys.argv[0]) == "expertaug":
        with open(os.path.join(os.environ["RECORD"], uuid.uuid4().hex), "w") as stream:
            json.dump([sys.argv[1], [f for f in files if f]], stream)
atexit.register(record)
"""


def snakemake(project: Path, *arguments: object, **environment: str) -> subprocess.CompletedProcess:
    """Run Snakemake in the project with the package that lies there."""
    return subprocess.run(
        [sys.executable, "-m", "snakemake", "--cores", "2", *map(str, arguments)],
        cwd=project,
        env=env_of(project) | environment,
        capture_output=True,
        text=True,
        timeout=600,
    )


def env_of(project: Path) -> dict[str, str]:
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return os.environ | {"PATH": path, "PYTHONPATH": str(project / "src"), "OMP_NUM_THREADS": "1"}


def planned(project: Path, *arguments: object) -> dict[str, int]:
    """Jobs that would be run, by rule; target rules left out."""
    done = snakemake(project, "--quiet", "host", "-n", *arguments)
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
    """Command-line arguments that add ``change`` to the smoke configuration."""
    path = project / "change.yaml"
    path.write_text(yaml.safe_dump(change))
    return [*SMOKE, path]


@pytest.fixture(scope="session")
def project(tmp_path_factory) -> Path:
    """A copy of the project in which the smoke run has ended well."""
    folder = copy_project(tmp_path_factory.mktemp("project"))
    record = folder / "record"
    record.mkdir()
    (record / "sitecustomize.py").write_text(RECORDER)
    python_path = os.pathsep.join([str(folder / "src"), str(record)])
    done = snakemake(folder, *SMOKE, PYTHONPATH=python_path, RECORD=str(record))
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.startswith(("expertaug ", "Error in rule"))]
        pytest.fail("the smoke run failed: " + "; ".join(lines or done.stderr.splitlines()[-3:]), pytrace=False)
    return folder


def test_smoke_run_makes_tables_figures_and_logs(project):
    results = project / "results" / "smoke"
    found = {path.relative_to(results).as_posix() for path in results.rglob("*") if path.is_file()}
    for experiment in ("pendulum", "double_pendulum"):
        wanted = {f"tables/{experiment}.{end}" for end in ("csv", "md", "tex")}
        wanted |= {f"figures/{experiment}_{name}.png" for name in ("log_mse", "forecasts", "parameters", "curves")}
        wanted |= {
            f"{experiment}/aphynity+/seeds_0_1/{name}" for name in ("model.safetensors", "metrics.csv", "log.jsonl")
        }
        assert wanted <= found
    assert {
        f"tables/pendulum_{name}.md" for name in ("during_training", "prior_width", "out_of_expertise", "published")
    } <= found
    assert {
        f"figures/{name}.png" for name in ("log_mse", "parameter_errors", "za_shifted", "pendulum_during_training")
    } <= found
    assert {"recordings/summary.md", "double_pendulum/data/calibration.json", "mlflow/mlflow.db"} <= found
    assert "logs/train/pendulum_aphynity_seeds_0_1.log" in found
    assert "benchmarks/train/pendulum_aphynity_seeds_0_1.tsv" in found
    table = (results / "tables" / "pendulum.md").read_text()
    assert all(label in table for label in ("Mean", "Expert only", "ML only", "APHYNITY", "APHYNITY+", "corrected"))


def test_frame_stores_and_checkpoints_are_gone(project):
    results = project / "results" / "smoke"
    assert not list(results.rglob("frames.b2frame"))
    assert not list(results.rglob("checkpoint.pt"))


def test_a_second_run_does_nothing(project):
    done = snakemake(project, *SMOKE)
    assert "Nothing to be done" in done.stdout + done.stderr


def test_touched_files_redo_nothing(project):
    for path in [project / "constraints.txt", *(project / "src").rglob("*.py")]:
        path.touch()
    assert planned(project, *SMOKE) == {}


WIDER = {"augmentation": {"prior": {"omega0": [0.5, 4]}}}


@pytest.mark.parametrize(
    ("change", "rules"),
    [
        ({"experiments": {"pendulum": {"finetuning": {"epochs": 5}}}}, TUNED),
        ({"experiments": {"pendulum": {"overrides": {"aphynity": WIDER}}}}, {"augment_seed_group"} | TUNED),
        ({"experiments": {"pendulum": {"evaluation": {"samples": 2}}}}, SCORED),
        ({"experiments": {"pendulum": {"training": {"learning_rate": 0.001}}}}, TRAINED),
        (
            {"experiments": {"pendulum": {"data": {"sets": {"test": {"size": 21}}}}}},
            {"simulate_set", "during_training_seed_group"} | SCORED,
        ),
        ({"experiments": {"pendulum": {"data": {"sets": {"near": {"size": 8}}}}}}, {"simulate_set"} | SCORED),
        (
            {"experiments": {"pendulum": {"studies": {"during_training": {"epochs": [2]}}}}},
            TRAINED - {"train_seed_group"},
        ),
        ({"experiments": {"pendulum": {"evaluation": {"published": "rlc"}}}}, {"compare_experiment", "compare_all"}),
        ({"experiments": {"double_pendulum": {"data": {"split": {"stride": 3}}}}}, CHUNKS),
        ({"recordings": {"angles": {"max_gap_frames": 4}}}, ANGLES),
        ({"recordings": {"tracking": {"min_level": 25}}}, MARKERS),
        ({"choices": {"frozen": "interaction_and_z_e_head"}}, TUNED),
        ({"methods": {"ml_only": {"label": "Neural ODE"}}}, {"train_seed_group"} | SCORED),
        ({"tracking": {"uri": "sqlite:///elsewhere.db"}}, {"init_tracking"}),
        ({"device": "cpu"}, TRAINED),
    ],
)
def test_a_changed_parameter_redoes_exactly_its_stages(project, change, rules):
    assert set(planned(project, *override(project, change))) == rules


def test_a_changed_parameter_leaves_the_other_experiment_alone(project):
    jobs = planned(project, *override(project, {"experiments": {"pendulum": {"training": {"batch_size": 10}}}}))
    assert (jobs["train_seed_group"], jobs["train_seed_group_with_snapshots"], jobs["tabulate_experiment"]) == (2, 1, 1)


@pytest.mark.parametrize(
    ("module", "rules"),
    [
        ("cli.py", set()),
        ("systems/pendulum.py", {"simulate_set"} | TRAINED),
        ("evaluation/tables.py", {"tabulate_experiment"}),
        ("recordings/figures.py", {"plot_splits_of_experiment", "plot_page_of_recording"}),
        ("recordings/overlay.py", set()),
        ("learning/finetune.py", TUNED),
        ("evaluation/published.py", {"compare_experiment", "compare_all"}),
        ("evaluation/paper.csv", {"compare_experiment", "compare_all"}),
        ("recordings/calibration.py", {"calibrate_experiment"} | LEARNING),
        ("recordings/tracker.py", MARKERS),
    ],
)
def test_a_changed_module_redoes_exactly_its_stages(project, module, rules):
    path = project / "src" / "expertaug" / module
    before = path.read_text()
    try:
        path.write_text(f"{before}# changed\n")
        assert set(planned(project, *SMOKE)) == rules
    finally:
        path.write_text(before)


BASES = {"train_seed_group", "train_seed_group_with_snapshots"}
TUNING = {"augment_seed_group", "finetune_seed_group"}
MEASURED = {"measure_angles_of_recording", "split_chunks_of_experiment", "calibrate_experiment"}


@pytest.mark.parametrize(
    ("file", "target", "rules"),
    [
        ("recordings/*/video.mp4", "track_markers", {"render_video_of_recording"} | MARKERS - ANGLES),
        ("recordings/*/markers.csv", "calibrate", (MARKERS - ANGLES) | MEASURED),
        ("recordings/*/angles.csv", "calibrate", MEASURED),
        ("double_pendulum/data/train.npz", "calibrate", MEASURED - {"measure_angles_of_recording"}),
        ("double_pendulum/data/calibration.json", "train", {"calibrate_experiment", "train_seed_group"}),
        ("pendulum/data/train.npz", "train", {"simulate_set"} | BASES),
        ("pendulum/data/near.npz", "evaluate", {"simulate_set", "evaluate_seed_group"}),
        ("pendulum/aphynity/*/model.safetensors", "augment", {"train_seed_group_with_snapshots", "augment_seed_group"}),
        ("pendulum/aphynity/*/model.safetensors", "finetune", {"train_seed_group_with_snapshots"} | TUNING),
        (
            "pendulum/aphynity/*/snapshots.safetensors",
            "during_training",
            {"train_seed_group_with_snapshots", "during_training_seed_group"},
        ),
        ("pendulum/aphynity+/*/augmented.safetensors", "finetune", TUNING),
        ("pendulum/aphynity+wide/*/model.safetensors", "evaluate", {"finetune_seed_group", "evaluate_seed_group"}),
        ("pendulum/aphynity+wide/*/metrics.csv", "studies", {"evaluate_seed_group", "study_experiment"}),
        ("pendulum/aphynity/*/during_training.csv", "studies", {"during_training_seed_group", "study_experiment"}),
        (
            "pendulum/ml_only/*/model.safetensors",
            "pendulum",
            {"train_seed_group"} | SCORED - {"plot_overview", "compare_all"},
        ),
    ],
)
def test_what_a_stopped_job_has_left_missing_is_made_again(project, file, target, rules):
    found = next((project / "results" / "smoke").glob(file))
    aside = found.rename(project / "aside")
    try:
        assert set(planned(project, target, *SMOKE)) == rules
        assert rules <= set(planned(project, *SMOKE))
    finally:
        aside.rename(found)


def test_declared_modules_cover_what_every_job_has_loaded(project):
    files = [project / name for name in ("config/config.yaml", "config/smoke.yaml", "studies.yaml")]
    found = config.validate(config.load(files))
    named = {m for e in found["run"] for m in stage_settings.modules(found, e, "aphynity")}
    package = project / "src"
    without = {*(f"{m.replace('.', '/')}.py" for m in source_files.WITHOUT_EFFECT)}
    stages = set()
    for record in (project / "record").iterdir():
        if record.suffix == ".py" or record.is_dir():
            continue
        command, files = json.loads(record.read_text())
        stage = command.replace("-", "_")
        stages.add(stage)
        loaded = {Path(file).relative_to(package).as_posix() for file in files} - without
        declared = {
            Path(path).resolve().relative_to(ROOT / "src").as_posix() for path in stage_code.sources(stage, named)
        }
        assert loaded <= declared, stage
    assert stages == set(stage_code.STAGES) - {"unpack_markers", "import_markers", "overlay"}


def test_frame_stores_are_kept_when_they_are_asked_for(project):
    done = snakemake(project, "extract_frames", *SMOKE)
    stores = list((project / "results" / "smoke").rglob("frames.b2frame"))
    assert done.returncode == 0 and len(stores) == 2
    assert planned(project, *SMOKE) == {}
    for store in stores:
        store.unlink()
    assert planned(project, *SMOKE) == {}


def test_every_stage_is_a_target(project):
    for target in TARGETS:
        plan = planned(project, target, "--forceall", *SMOKE)
        assert plan, target
        assert any(rule.startswith("train_seed_group") for rule in plan) == (
            target in [*LEARNING_TARGETS, "everything", "all"]
        ), target


def test_report_is_one_file_with_tables_and_figures(project):
    done = snakemake(project, "--report", "report.html", *SMOKE)
    assert done.returncode == 0, done.stderr
    text = (project / "report.html").read_text()
    for name in ("pendulum_log_mse.png", "double_pendulum_splits.png", "pendulum.md", "summary.md", "page.png"):
        assert name in text


def test_both_entry_points_run_the_same_jobs_from_anywhere(tmp_path):
    project = copy_project(tmp_path / "project")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    plans = [
        planned(project),
        planned(project, "--directory", elsewhere),
        planned(elsewhere, "-s", project / "workflow" / "Snakefile"),
    ]
    assert plans[0] == plans[1] == plans[2]
    found = config.validate(config.load([project / "config" / "config.yaml"]))
    models = sum(len(found["experiments"][name]["methods"]) for name in found["run"]) * len(
        stage_settings.seed_groups(found)
    )
    assert plans[0]["train_seed_group"] + plans[0]["train_seed_group_with_snapshots"] == models
    assert not list(elsewhere.glob("results"))


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"seeds": [0, "1e-3"]}, "configuration: seeds[1]: found '1e-3', which YAML takes for a text; write 1.0e-3"),
        (
            {"recordings": {"source": "markers", "markers": {"path": "bad"}}},
            "configuration: bad: two files of one name",
        ),
        (
            {"recordings": {"source": "videos", "videos": {"path": "none"}}},
            "configuration: recordings.videos.path: no video",
        ),
    ],
)
def test_bad_configuration_is_one_line_and_status_2(tmp_path, change, line):
    project = copy_project(tmp_path / "project")
    for folder in ("a", "b"):
        (project / "bad" / folder).mkdir(parents=True)
        (project / "bad" / folder / "0.csv").touch()
    done = snakemake(project, *override(project, change))
    errors = [text for text in done.stderr.splitlines() if not text.startswith(("Using ", "Config file "))]
    assert done.returncode == 2
    assert len(errors) == 1 and errors[0].startswith(line), done.stderr
    assert not (project / "results").exists()


def test_an_archive_is_unpacked_before_its_recordings_are_known(tmp_path):
    project = copy_project(tmp_path / "project")
    (project / "markers.tar.gz").touch()
    change = {"recordings": {"source": "markers", "markers": {"path": "markers.tar.gz"}}}
    assert set(planned(project, "recordings", *override(project, change))) == {"unpack_markers", "summarise_recordings"}
    done = snakemake(project, "recordings", *override(project, change))
    assert done.returncode == 1
    assert "expertaug unpack-markers: markers.tar.gz: " in done.stderr


def test_a_killed_training_resumes_to_the_same_bits(tmp_path):
    project = copy_project(tmp_path / "project")
    model, tensors = "pendulum/aphynity/seeds_0_1/model.safetensors", {}
    training = {"epochs": 40, "checkpoint_s": 0.0}
    for name in ("whole", "killed"):
        change = {"experiments": {"pendulum": {"training": training}}, "tracking": {"enabled": False}}
        arguments = [f"results/{name}/{model}", *override(project, change | {"results": f"results/{name}"})]
        if name == "killed":
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


def kill_when_there(project: Path, arguments: list, checkpoint: Path) -> None:
    """Start Snakemake, and kill it with its jobs as soon as a checkpoint is written."""
    command = [sys.executable, "-m", "snakemake", "--cores", "2", *map(str, arguments)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    running = subprocess.Popen(command, cwd=project, env=env_of(project), start_new_session=True, **quiet)
    try:
        until = time.monotonic() + 120
        while not checkpoint.exists():
            assert running.poll() is None and time.monotonic() < until, "no checkpoint"
            time.sleep(0.02)
    finally:
        os.killpg(running.pid, signal.SIGKILL)
        running.wait()
