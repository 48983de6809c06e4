"""What is redone after a change: exactly the stages that it touches."""

from __future__ import annotations

import pytest
from running import (
    ALONG,
    ANGLES,
    CHUNKS,
    COMPARED,
    LEARNING,
    MARKERS,
    SCORED,
    SMOKE,
    TRAINED,
    TUNED,
    override,
    planned,
    snakemake,
)


def test_a_second_run_does_nothing(project):
    done = snakemake(project, *SMOKE)
    assert "Nothing to be done" in done.stdout + done.stderr


def test_touched_files_and_pinned_versions_that_are_not_installed_redo_nothing(project):
    with (project / "constraints.txt").open("a") as stream:
        stream.write("# a comment\n")
    for path in [project / "constraints.txt", *(project / "src").rglob("*.py")]:
        path.touch()
    assert planned(project, *SMOKE) == {}


WIDER = {"augmentation": {"prior": {"omega0": [0.5, 4]}}}
PLOTTED = {"plot_experiment", "plot_overview"}  # which read the long tables


@pytest.mark.parametrize(
    ("change", "rules"),
    [
        ({"experiments": {"pendulum": {"finetuning": {"epochs": 5}}}}, TUNED),
        (
            {"experiments": {"pendulum": {"overrides": {"aphynity": WIDER}}}},
            {"augment_seed_group", "flow_seed_group", "validity_of_experiment"} | TUNED,
        ),
        ({"experiments": {"pendulum": {"evaluation": {"samples": 2}}}}, SCORED),
        ({"experiments": {"pendulum": {"training": {"learning_rate": 0.001}}}}, TRAINED),
        (
            {"experiments": {"pendulum": {"data": {"sets": {"test": {"size": 21}}}}}},
            {"simulate_set", "during_training_seed_group", "validity_of_experiment"} | ALONG | SCORED,
        ),
        ({"experiments": {"pendulum": {"data": {"sets": {"near": {"size": 8}}}}}}, {"simulate_set"} | ALONG | SCORED),
        (
            {"experiments": {"pendulum": {"studies": {"during_training": {"epochs": [2]}}}}},
            TRAINED,
        ),
        ({"experiments": {"pendulum": {"evaluation": {"published": "rlc"}}}}, {"write_report"} | COMPARED),
        ({"experiments": {"double_pendulum": {"data": {"split": {"stride": 3}}}}}, CHUNKS),
        ({"recordings": {"angles": {"max_gap_frames": 4}}}, ANGLES),
        ({"recordings": {"tracking": {"min_level": 25}}}, MARKERS),
        ({"experiments": {"pendulum": {"choices": {"frozen": "interaction_and_z_e_head"}}}}, TUNED),
        (
            {"methods": {"ml_only": {"label": "Neural ODE"}}},
            ({"train_seed_group"} | ALONG | SCORED) - {"prior_width_of_experiment", "estimates_of_experiment"},
        ),
        ({"tracking": {"uri": "sqlite:///elsewhere.db"}}, {"init_tracking"}),
        ({"device": "cpu"}, {"dissipation_of_experiment", "horizons_of_experiment"} | TRAINED),
    ],
)
def test_a_changed_parameter_redoes_exactly_its_stages(project, change, rules):
    assert set(planned(project, *override(project, change))) == rules


def test_a_changed_parameter_leaves_the_other_experiment_alone(project):
    jobs = planned(project, *override(project, {"experiments": {"pendulum": {"training": {"batch_size": 10}}}}))
    assert (jobs["train_seed_group"], jobs["tabulate_experiment"]) == (3, 1)


@pytest.mark.parametrize(
    ("module", "rules"),
    [
        ("expertaug/cli.py", set()),
        ("expertaug/systems/pendulum.py", {"simulate_set"} | TRAINED),
        ("expertaug/evaluation/tabulate.py", {"tabulate_experiment", "write_report"} | PLOTTED),
        ("expertaug_recordings/reports/page.py", {"plot_page_of_recording", "write_report"}),
        ("expertaug_recordings/reports/splits.py", {"plot_splits_of_experiment", "write_report"}),
        ("expertaug_recordings/reports/overlay.py", set()),
        ("expertaug/learning/finetune.py", {"horizons_of_experiment"} | TUNED),
        ("expertaug/evaluation/published.py", {"write_report"} | COMPARED),
        ("expertaug/evaluation/report/page.html", {"write_report"}),
        ("expertaug/evaluation/paper.csv", {"write_report"} | COMPARED),
        ("expertaug_recordings/angles/calibration.py", {"calibrate_experiment"} | LEARNING),
        ("expertaug_recordings/markers/tracker.py", MARKERS),
    ],
)
def test_a_changed_module_redoes_exactly_its_stages(project, module, rules):
    path = project / "src" / module
    before = path.read_text()
    try:
        path.write_text(f"{before}# changed\n")
        assert set(planned(project, *SMOKE)) == rules
    finally:
        path.write_text(before)


def test_a_grid_adds_its_own_jobs_and_no_other(project):
    grid = {
        "method": "aphynity",
        "keys": {"training.learning_rate": [0.001, 0.003], "model.encoder.layers": [[8], [4, 4]]},
    }
    change = {"experiments": {"pendulum": {"studies": {"grid": grid}}}}
    jobs = {"train_seed_group": 4, "grid_of_experiment": 1, "write_report": 1}
    assert planned(project, *override(project, change)) == jobs


@pytest.mark.parametrize(("package", "rules"), [("av", MARKERS), ("pandas", set())])
def test_another_installed_version_redoes_what_computes_with_it(project, tmp_path, package, rules):
    metadata = tmp_path / f"{package}-999.0.dist-info" / "METADATA"
    metadata.parent.mkdir()
    metadata.write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 999.0\n")
    path = f"{tmp_path}:{project / 'src'}"
    assert set(planned(project, *SMOKE, PYTHONPATH=path)) - {"render_video_of_recording"} == rules
