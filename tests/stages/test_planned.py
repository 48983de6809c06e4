"""The jobs that a configuration means: each once, for the versions that its name says, and what they make is kept."""

from __future__ import annotations

from expertaug.stages import STAGES
from expertaug.stages.files import Files
from expertaug.stages.planned import (
    list_kept,
    overviews,
    plan,
    products_of,
    products_of_all,
    stages_read,
    studies,
    study_files,
)
from shipped import alone, valid


def test_no_job_is_planned_twice_and_every_version_has_the_jobs_that_make_it(files):
    jobs = [job for job in plan(files.config) if job[0] != "log_evaluations"]
    assert len(jobs) == len({str(job) for job in jobs})
    of_stage = {}
    for stage, names in jobs:
        of_stage.setdefault(stage, []).append(names)
    versions = {stage: {names[1] for names in given} for stage, given in of_stage.items() if len(given[0]) == 3}
    assert versions["augment"] == set(files.augmented("pendulum"))
    assert versions["finetune"] == set(files.finetuned("pendulum"))
    assert versions["flow"] == set(files.flows("pendulum"))
    assert versions["evaluate"] == set(files.variants("pendulum"))
    assert versions["train"] | versions["alternate"] == set(files.methods("pendulum"))
    assert [names[1] for names in of_stage["simulate"]] == ["train", "validation", "iid", "test"]


def test_stages_read_what_others_of_the_run_make(files):
    run = {stage for stage, _ in plan(files.config)}
    pairs = stages_read(files.config)
    assert {("simulate", "train"), ("train", "augment"), ("augment", "finetune"), ("evaluate", "tabulate")} <= set(
        pairs
    )
    assert all({source, stage} <= run and source in STAGES[stage].reads for source, stage in pairs)


def test_studies_are_made_after_all_that_they_read(files):
    assert {"prior_width", "alarm", "validity"} <= set(studies(files, "pendulum"))
    made = study_files(files, "pendulum", ["alarm"])
    first = made.index("results/tables/pendulum_alarm.csv")
    read = [path for path in made if path.endswith("forecasts.npz")]
    assert read and all(made.index(path) < first for path in read)
    assert study_files(files, "pendulum", ["horizons"]) == []


def test_what_is_kept_of_a_run_is_all_that_it_shows_with_figures_as_pictures(files):
    shown = [*products_of(files, "pendulum"), *products_of_all(files)]
    assert len(shown) == len(set(shown))
    assert {path.removeprefix("results/") for path in shown if not path.endswith(".pdf")} <= set(
        list_kept(["pendulum"])
    )
    assert not any(path.endswith(".pdf") for path in list_kept(["pendulum"]))


def test_a_run_that_shows_nothing_of_all_experiments_has_no_figures_of_them(files):
    assert overviews(files.config) == ["log_mse", "parameter_errors"]
    hidden = Files(valid(alone("pendulum"), "experiments: {pendulum: {evaluation: {overview: false}}}"))
    assert overviews(hidden.config) == []
    assert "overview" not in {stage for stage, _ in plan(hidden.config)}
