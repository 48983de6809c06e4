"""What stages do is a call in memory: values in, a study out, and no file."""

from __future__ import annotations

import io

import numpy as np
import pytest
from fake_windows import SEEDS, curves, forecasts
from matplotlib.figure import Figure
from rubbing_pendulum import JOB, motion, pendulum

from cards import card
from expertaug.evaluation.alarms import alarm
from expertaug.evaluation.coverage import coverage
from expertaug.evaluation.dissipation import dissipation
from expertaug.evaluation.distance import distance
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.grid import grid
from expertaug.evaluation.published import compare
from expertaug.evaluation.report.page import report
from expertaug.evaluation.report.shown import Picture, Results, Shown
from expertaug.evaluation.report.tables import Frame
from expertaug.evaluation.run_record import RunRecord
from expertaug.evaluation.samples import Samples
from expertaug.evaluation.settings import (
    CompareJob,
    GridJob,
    ReportExperiment,
    ReportJob,
    StudyJob,
    StudyOptions,
)
from expertaug.evaluation.studies import study
from expertaug.evaluation.summary import with_intervals
from expertaug.evaluation.tabulate import tabulate
from expertaug.models.decoder import Decoder
from expertaug.models.store import StoredModel
from expertaug.tracking.metrics_csv import MetricRow


@pytest.fixture(autouse=True)
def no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    yield
    assert not list(tmp_path.iterdir())


def rows(of: Forecasts, label: str) -> list[MetricRow]:
    """The log-MSE of these errors."""
    whose = of.identified()
    named = (whose.experiment, "pendulum", whose.method, label, whose.preset)
    return [
        MetricRow(*named, seed, name, "log_mse_sum", float(np.log(errors.mean())))
        for name, of_set in of.sets.items()
        for seed, errors in zip(of.seeds, of_set.errors, strict=True)
    ]


@pytest.mark.parametrize("make", [alarm, coverage, distance])
def test_studies_of_windows(make):
    made = make([forecasts()], curves())
    assert set(made.numbers["method"]) == {"a"} and made.tables[0].size and isinstance(made.figure(), Figure)


def test_tables_and_studies_of_scores():
    of = forecasts("aphynity", "swing")
    scores = rows(of, "APHYNITY")
    table = tabulate(scores, forecasts=[of])
    low, mean, high = (table.numbers[f"test/log_mse_sum/{name}"][0] for name in ("low", "mean", "high"))
    assert low < mean < high and "APHYNITY" in table.markdown()
    shifts = StudyOptions(distances=["none"], panels=[("z_e shifted", ["test"])])
    job = StudyJob(study="out_of_expertise", labels=[("aphynity", "APHYNITY")], options=shifts)
    asked = study(scores, job, [of])
    assert list(asked.numbers.query("set == 'test'")["low"]) == [pytest.approx(low)]
    beside = compare(scores, [of], CompareJob(published=[["swing", "pendulum"]])).numbers.set_index(["label", "set"])
    assert beside.loc[("APHYNITY", "test"), "mean"].iloc[0] == pytest.approx(mean)


def test_studies_of_models():
    described = {"kind": "least_squares", "seeds": SEEDS, "t": motion(1).t.tolist(), "observed": 11}
    described["system"] = {"name": "double_pendulum", "expert": "compound"}
    models = [
        StoredModel(Decoder(pendulum(friction=friction)), card(described | {"method": name}))
        for name, friction in (("rubbing", (0.1, 0.1)), ("half", (0.05, 0.05)))
    ]
    sets = {name: motion(6, k) for k, name in enumerate(("train", "validation", "test"))}
    numbers = dissipation(models, sets, JOB).numbers
    whole, half = (numbers.query("method == @name")["dissipated"].to_numpy() for name in ("rubbing", "half"))
    np.testing.assert_allclose(half, whole / 2, rtol=1e-4)
    scores = {"method": "a@1", "seeds": SEEDS, "best_score": [-1.0, -2.0], "best_epoch": [3, 5], "wall_s": 60.0}
    job = GridJob(experiment="lab", label="A", keys=["training.epochs"], points=[("a@1", [9])])
    assert list(grid({"first": card(scores, t=[0.0], observed=1)}, job).numbers["mean"]) == [-1.5]


def test_the_page():
    """A study's own numbers and figure, on a page of an experiment's long table."""
    of = forecasts("aphynity", "swing")
    long = with_intervals(rows(of, "APHYNITY"), Samples([of]))
    study = distance([forecasts()], curves())
    stream = io.BytesIO()
    study.figure().savefig(stream, format="png")
    shown = [
        Shown(
            "figures/swing_distance.png",
            "How far it goes.",
            {"experiment": "swing"},
            "distance",
            Picture.of(stream.getvalue()),
        ),
        Shown("tables/swing_distance.md", "", {"experiment": "swing"}, "distance", numbers=Frame(study.numbers)),
    ]
    job = ReportJob(
        shown=[],
        rules=[("train", "evaluate")],
        experiments=[ReportExperiment(name="swing", labels=[])],
        files=["a.yaml"],
        preset="corrected",
        seeds=SEEDS,
        device="cpu",
    )
    record = RunRecord(["1f2e"], {"expertaug": "1"}, {"processor": "none"}, 0, 0)
    page = report(Results([long], shown, record), job)
    assert "<h1>Results of swing</h1>" in page and "How far it goes." in page and "1f2e" in page
    assert page.count("data:image/png;base64,") == 1 and "The numbers of Figure 1" in page
