"""Every figure stands values that are all zero, not finite or missing."""

from __future__ import annotations

import io
import re
import warnings

import numpy as np
import pandas as pd
import pytest
import torch
from fake_runs import loaded, method_of, pairs, rows_of, tables_of, write_forecasts, write_logs, write_metrics
from fake_windows import curves, fake

from expertaug import plotting
from expertaug.evaluation import dissipation, dots, estimates, grid, parameters, studies, traces, validity
from expertaug.evaluation.alarms import alarm
from expertaug.evaluation.coverage import coverage
from expertaug.evaluation.distance import distance
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.settings import (
    DissipationJob,
    EstimatesJob,
    FittedVersion,
    GridJob,
    OverviewExperiment,
    OverviewJob,
    PlotJob,
    StudyJob,
    StudyOptions,
    ValidityJob,
)
from expertaug.evaluation.studies import study
from expertaug.evaluation.summary import TabledMean, read_metrics
from expertaug.inference.diagnostics.validity import Refit, Validity
from expertaug.inference.settings import ValiditySettings
from expertaug.tracking.log import read_log
from nightly import others_slow

VALUES = {"zero": 0.0, "missing": np.nan, "infinite": np.inf}


@pytest.fixture(params=others_slow(["missing", "infinite", "zero"]), autouse=True)
def value(request):
    """All of a figure's numbers; whatever Matplotlib cannot draw is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", category=DeprecationWarning)
        for message in ("All-NaN", "Mean of empty", "invalid value", "divide by zero", "Degrees of freedom"):
            warnings.filterwarnings("ignore", message=message)
        yield VALUES[request.param]


@pytest.fixture
def metrics(tmp_path, value):
    paths = write_metrics(tmp_path)
    for path in paths:
        pd.read_csv(path).assign(value=value).to_csv(path, index=False)
    return paths


def test_estimates(value):
    numbers = dict.fromkeys(("value", "error", "low", "high", "spread"), value)
    one = estimates.TabledEstimate("a", "A", "omega0", "rad/s", "all", **numbers, windows=3, groups=3, told=None)
    with plotting.use_style():
        estimates.draw([one], EstimatesJob(labels=[("a", "A")]), "swings").savefig(io.BytesIO())


def test_dots(metrics):
    job = PlotJob(**pairs(), floor=method_of("Mean"))
    rows = rows_of(tables_of(metrics))
    one = OverviewExperiment(name="swing", shown=True, shifted="test", opponents=[])
    of_all = dots.overview(rows, OverviewJob(experiments=[one], hues=[]))
    for figure in (dots.log_mse(rows, job), dots.parameter_errors(rows, job), *of_all.values()):
        drawn(figure)


@pytest.mark.parametrize("name", ["out_of_expertise", "horizons", "prior_width"])
def test_studies(metrics, name):
    labels = [(method_of(label), label) for label in ("Hybrid", "Hybrid+")]
    options = StudyOptions(distances=["none"], panels=[("near", ["test"])])
    priors = {"hybrid": {"": {"omega0": (0.5, 1.5)}}}
    job = StudyJob(study=name, labels=labels, options=options, priors=priors, hues=[("hybrid", 0)])
    drawn(study(read_metrics(metrics), job).figure())


def test_along_a_training(value):
    whose = {"experiment": "swing", "system": "pendulum", "preset": "paper", "method": "hybrid", "label": "Hybrid"}
    numbers = {"mean": value, "std": value, "n": int(np.isfinite(value)), "of": 2, "epoch": 1, "finetune_epochs": 0}
    numbers |= {"seeds": (0, 1), "low": value, "high": value}
    summary = [TabledMean(**whose, set=s, metric="log_mse_sum", **numbers) for s in ("train", "validation", "test")]
    figure = studies.during_training(summary, StudyJob(study="during_training", labels=[("hybrid", "Hybrid")]))
    drawn(figure)


@pytest.mark.slow
def test_forecasts_parameters_and_curves(tmp_path, value):
    paths = write_forecasts(tmp_path)
    for path in paths.values():
        arrays = dict(np.load(path))
        for name in arrays:
            if name.endswith(("prediction", "z_e_hat", "truth")):
                arrays[name] = np.full_like(arrays[name], value)
        np.savez(path, **arrays)
    drawn(traces.forecasts(loaded(paths)))
    drawn(parameters.parameters(loaded(paths)))
    logs = write_logs(tmp_path, steps=20)
    for path in logs:
        number = str(value) if np.isfinite(value) else {"nan": "NaN", "inf": "Infinity"}[str(value)]
        text = re.sub(r'("loss": )\[[^]]*\]', rf"\1[{number}, {number}, {number}]", path.read_text())
        path.write_text(text)
    drawn(traces.curves(map(read_log, logs)))


def test_single_windows(tmp_path, value):
    spoiled = {
        f"{name}_{key}": np.full((2, 400, *more), 1.0 if key == "errors" and np.isnan(value) else value)
        for name in ("validation", "iid", "test")
        for key, more in (("errors", ()), ("misfit", ()), ("z_e_hat", (1,)))
    }
    forecasts = Forecasts.load(fake(tmp_path / "a.npz", "a", [0, 1], spoiled=spoiled))
    for study_of_windows in (alarm, coverage, distance):
        drawn(study_of_windows([forecasts], curves()).figure())


def test_grid(value):
    job = GridJob(experiment="e", label="A", keys=["training.epochs"], points=[("a@1", [1]), ("a@2", [2])])
    scores = [grid.SeedScore(point, 0, value, 1, 0.0) for point in ("a@1", "a@2")]
    drawn(grid._draw(scores, grid.summarise(scores, job), job))


def test_dissipation(value):
    losses = [dissipation.Loss("e", "a", "A", 0, "", name, "all", 1, value, 0.0, value) for name in ("train", "test")]
    job = DissipationJob(experiment="e", versions=[FittedVersion("a", "A", None)], device="cpu")
    drawn(dissipation.draw(losses, job))


def test_validity(value):
    some = torch.full((1, 4), value, dtype=torch.float64)
    refit = Refit(some.unsqueeze(-1).nan_to_num(1.0, 1.0), some, some, some, some)
    edges = np.linspace(0.0, 1.0, 4)
    along = Validity("omega0", edges, np.full(3, value), np.full(3, value), value, (0.0, 1.0))
    found = {"a": validity.OfVersion("A", {"train": refit, "test": refit}, along, "omega0", "1/s")}
    job = ValidityJob(experiment="e", versions=[], validity=ValiditySettings(), device="cpu")
    figure = validity._draw(found, job, "title")
    drawn(figure)
    assert figure.legends[0].get_texts()[-1].get_text() == "range of the training windows' estimates"
    figure = validity._draw(found, job, "title", (0.2, 0.5))
    assert [patch.get_x() for patch in figure.axes[0].patches] == [0.2] and len(figure.axes[0].get_xticks()) <= 7
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["A", "training windows (left: their 95 % quantile)", "training range"]
    assert figure.axes[0].get_xlabel() == r"$\omega_{0}$ [1/s]"


def drawn(figure):
    """Draw a figure as saving does."""
    with plotting.use_style():
        figure.savefig(io.BytesIO())
