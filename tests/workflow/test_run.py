"""The workflow as a whole: one smoke run from an empty folder, its targets, and what it says of bad input."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from running import LEARNING_TARGETS, ROOT, SMOKE, TARGETS, copy_project, override, planned, snakemake

from expertaug import source_files
from expertaug.config import jobs
from expertaug.config import load as config
from expertaug.plotting import NOTE
from expertaug.stages import STAGES
from nightly import others_slow


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
    followed = {path.relative_to(results).parts[:2] for path in results.rglob("snapshots.*") if path.stat().st_size}
    assert followed == {("pendulum", "aphynity")}
    assert {"recordings/summary.md", "double_pendulum/data/calibration.json", "mlflow/mlflow.db"} <= found
    assert "logs/train/pendulum_aphynity_seeds_0_1.log" in found
    assert "logs/train/pendulum_aphynity_seeds_0_1.cost.json" in found
    table = (results / "tables" / "pendulum.md").read_text()
    assert all(label in table for label in ("Mean", "Expert only", "ML only", "APHYNITY", "APHYNITY+", "corrected"))


def test_frame_stores_and_checkpoints_are_gone(project):
    results = project / "results" / "smoke"
    assert not list(results.rglob("frames.b2frame"))
    assert not list(results.rglob("checkpoint.pt"))


def without_effect(package: Path, module: str) -> list[str]:
    """Files of a module, or of a folder, whose change redoes nothing."""
    base = package / module.replace(".", "/")
    found = base.rglob("*.py") if base.is_dir() else [base.with_suffix(".py")]
    return [path.relative_to(package).as_posix() for path in found]


AT_REQUEST = ("draw_worst_frames", "review", "export_recording")
# Of other sources, of a p⁺ without given ranges, of constants that windows share, or what is asked for elsewhere.
ELSEWHERE = (
    "unpack_markers",
    "import_markers",
    "cut_measurements",
    "cut_measured_horizon",
    "own_prior",
    "tabulate_own_prior",
    "share",
    "equation",
    "data_curves",
)


def test_declared_modules_cover_what_every_job_has_loaded(smoke_run):
    files = [smoke_run / name for name in ("config/config.yaml", "config/smoke.yaml", "studies.yaml")]
    found = config.validate(config.load(files))
    named = {m for e in found.run for m in jobs.modules(found, e, "aphynity")}
    package = smoke_run / "src"
    without = {file for m in source_files.WITHOUT_EFFECT for file in without_effect(package, m)}
    stages = set()
    for record in (smoke_run / "record").iterdir():
        if record.suffix == ".py" or record.is_dir():
            continue
        command, files = json.loads(record.read_text())
        stage = command.replace("-", "_")
        stages.add(stage)
        loaded = {Path(file).relative_to(package).as_posix() for file in files} - without
        declared = {path.relative_to(ROOT / "src").as_posix() for path in STAGES[stage].sources(named)}
        assert loaded <= declared, stage
    assert stages == set(STAGES) - {"overlay", "grid", *AT_REQUEST, *ELSEWHERE}


def test_frame_stores_are_kept_when_they_are_asked_for(project):
    done = snakemake(project, "extract_frames", *SMOKE)
    stores = list((project / "results" / "smoke").rglob("frames.b2frame"))
    assert done.returncode == 0 and len(stores) == 2
    assert planned(project, *SMOKE) == {}
    for store in stores:
        store.unlink()
    assert planned(project, *SMOKE) == {}


@pytest.mark.parametrize("target", TARGETS)
def test_every_stage_is_a_target(project, target):
    plan = planned(project, target, "--forceall", *SMOKE)
    assert plan or target == "cut_measurements", "the small run has none"
    assert ("train_seed_group" in plan) == (target in [*LEARNING_TARGETS, "everything", "all"])


def test_the_report_shows_every_table_and_figure_with_its_caption(project):
    page = (project / "results/smoke/report.html").read_text()
    linked = re.findall(r"(?:src|href)=\"(?!data:|#)([^\"]*)", page)
    assert all(link.startswith("http://127.0.0.1:5000/#/experiments/") for link in linked), "it needs no other file"
    drawn = list((project / "results/smoke/figures").glob("*.png"))
    pages = list((project / "results/smoke/recordings").glob("*/page.png"))
    empty = [file for file in drawn if f"Comment\0{NOTE}".encode() in file.read_bytes()[:4096]]
    assert len(empty) < 4, "few of the small run have nothing to draw"
    assert len(re.findall("<img src=", page)) == len(drawn) - len(empty) + len(pages)
    for words in ("log-MSE of", "Costs", "config/smoke.yaml", "APHYNITY+"):
        assert words in page
    assert "{{" not in page and "snakemake." not in page, "a caption is not filled in"


def test_snakemakes_report_is_one_file_with_tables_and_figures(project):
    done = snakemake(project, "--report", "report.html", *SMOKE)
    assert done.returncode == 0, done.stderr
    text = (project / "report.html").read_text()
    for name in ("pendulum_log_mse.png", "double_pendulum_splits.png", "pendulum.md", "summary.md", "page.png"):
        assert name in text


@pytest.mark.slow
def test_both_entry_points_run_the_same_jobs_from_anywhere(tmp_path):
    project = copy_project(tmp_path / "project")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    plans = [
        planned(project),
        planned(project, "--directory", elsewhere),
        planned(elsewhere, "-s", project / "workflow" / "Snakefile", PYTHONPATH=str(project / "src")),
    ]
    assert plans[0] == plans[1] == plans[2]
    found = config.validate(config.load([project / "config" / "config.yaml"]))
    models = sum(len(found.experiments[name].methods) for name in found.run) * len(jobs.seed_groups(found))
    assert plans[0]["train_seed_group"] == models
    assert not list(elsewhere.glob("results"))


@pytest.mark.parametrize(
    ("change", "line"),
    others_slow(
        [
            (
                {"recordings": {"source": "markers", "markers": {"path": "bad"}}},
                "configuration: bad: two files of one name",
            ),
            (
                {"recordings": {"source": "videos", "videos": {"path": "none"}}},
                "configuration: recordings.videos.path: no video",
            ),
            (
                {"results": "bad", "recordings": {"source": "markers", "markers": {"path": "bad/a"}}},
                "configuration: recordings.markers.path: 'bad/a/0.csv' lies in the results folder 'bad'",
            ),
            (
                {"seeds": [0, "1e-3"]},
                "configuration: seeds[1]: found '1e-3', which YAML takes for a text; write 1.0e-3",
            ),
        ],
    ),
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
    last = done.stderr.splitlines()[-5:]
    told = [line for line in last if line.startswith("expertaug unpack-markers: markers.tar.gz: ")]
    assert len(told) == 1 and told[0].endswith("(log: results/smoke/logs/unpack_markers.log)"), last


def test_the_terminal_says_how_long_the_run_takes(smoke_run):
    said = (smoke_run / "said").read_text()
    first = r"^\d+ jobs on 2 cores; the time left is estimated once some have ended\.$"  # nothing is published here
    assert len(re.findall(first, said, re.MULTILINE)) == 1
    left = [int(n) for n in re.findall(r"^About .+ left for (\d+) jobs?\.$", said, re.MULTILINE)]
    assert left == sorted(left, reverse=True) and left[-1] == 1
    assert sum(one.endswith("left for 1 job.") for one in said.splitlines()) == 1
