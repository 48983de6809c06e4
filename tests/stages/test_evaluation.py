"""Studies read what their question needs: forecasts of every version, models of one group of seeds, or nothing."""

from __future__ import annotations

import argparse
from pathlib import Path

from expertaug.stages import evaluation
from expertaug.stages.files import Files
from shipped import alone, valid


def test_studies_of_windows_read_the_forecasts_of_every_version(files):
    expected = [f"results/pendulum/{v}/seeds_0_1_2/forecasts.npz" for v in files.compared("pendulum")]
    for stage in (evaluation.Alarm, evaluation.Coverage, evaluation.Seeds, evaluation.Distance):
        assert stage.inputs(files, "pendulum", stage.name) == expected


def test_models_are_checked_of_the_first_group_of_seeds():
    files = Files(valid(alone("pendulum"), "{seeds: [3, 4], seeds_per_job: 1}"))
    checked = evaluation.Validity.inputs(files, "pendulum", "validity")
    assert "results/pendulum/aphynity/seeds_3/model.safetensors" in checked
    assert all("/seeds_3/" in path for path in checked) and not any("/mean/" in path for path in checked)
    assert evaluation.Validity.sets(files, "pendulum") == [
        f"results/pendulum/data/{name}.npz" for name in ("train", "iid", "test")
    ]


def test_what_nobody_asked_for_reads_nothing(files):
    for stage in (evaluation.Grid, evaluation.DataCurves, evaluation.Equation, evaluation.OwnPriors):
        assert stage.inputs(files, "pendulum", stage.key()) == []
    assert evaluation.Study.inputs(files, "pendulum", "out_of_expertise") == []
    assert evaluation.Dissipation.inputs(files, "pendulum", "dissipation") == [], "nobody measured it"


def test_a_study_tells_metrics_and_forecasts_apart(monkeypatch):
    given = []
    monkeypatch.setattr("expertaug.evaluation.studies.run_stage", lambda *a: given.append(a))
    parser = argparse.ArgumentParser()
    evaluation.Study.add_arguments(parser)
    named = ["a/metrics.csv", "a/forecasts.npz", "b/metrics.csv", "b/forecasts.npz"]
    evaluation.Study.run(parser.parse_args([*named, "--output", "t.csv", "t.png"]), "job")
    metrics, forecasts = ([Path(path) for path in named if path.endswith(end)] for end in (".csv", ".npz"))
    assert given == [(metrics, [Path("t.csv"), Path("t.png")], "job", forecasts)]


def test_a_study_along_a_training_reads_that_trainings_scores():
    study = "studies: {during_training: {method: aphynity, epochs: [1, 2]}}"
    files = Files(valid(alone("pendulum"), f"experiments: {{pendulum: {{{study}}}}}"))
    along = next(kind.name for kind in evaluation.Study.products() if kind.along)
    assert evaluation.Study.inputs(files, "pendulum", along) == [
        "results/pendulum/aphynity/seeds_0_1_2/during_training.csv"
    ]
    assert evaluation.Study.inputs(files, "pendulum", "prior_width")[0].endswith("aphynity/seeds_0_1_2/metrics.csv")
