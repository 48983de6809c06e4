"""The dashboard as somebody sees it who opens the link that a run ends with."""

from __future__ import annotations

import signal
from pathlib import Path
from types import SimpleNamespace

import browser
import numpy as np
import pytest
from logged import FIELDS, RUN, WORKER, initial, runs_of, settings, start

from expertaug.evaluation.report.links import Dashboard
from expertaug.evaluation.table import Table
from expertaug.runs.progress import Watch
from expertaug.tracking.run_log import RunLog
from expertaug.tracking.settings import Tracking, tracking_of_run
from expertaug.tracking.store import initialise

pytestmark = [pytest.mark.slow, pytest.mark.skipif(bool(browser.missing()), reason=browser.missing() or "-")]

SCORE = "selection score - observed window - per dimension"
# Slow enough for a browser, and what is trained again after the kill has the values that it had before.
SLOWLY = WORKER.replace("if step % 10 == 0: log.flush()", "if step % 10 == 0: log.flush(); time.sleep(0.5)")
SLOWLY = SLOWLY.replace("[-1]", "[190]").replace('metrics(late, {"loss": [190]', 'metrics(late, {"loss": [late]')


@pytest.fixture(scope="module")
def tracking(tmp_path_factory):
    """A method that has been trained and evaluated, in a results folder."""
    results = tmp_path_factory.mktemp("dashboard") / "results"
    found = settings(results)
    initialise(initial(found), results / "mlflow" / "tracking.json")
    folder = results / "swing" / "hybrid+" / "seeds_0_1"
    folder.mkdir(parents=True)
    np.savez(folder / "train.npz", y=np.zeros((5, 3, 2)))
    with RunLog(folder / "log.jsonl", RUN, found) as log:
        log.dataset("train", folder / "train.npz")
        for step in range(30):
            curve = np.exp(-step / 10) * np.array([1.0, 1.2])
            log.metrics(step, {"loss": curve, "validation_score": np.log(curve)})
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 4))
    figure.subplots().plot(np.sin(np.linspace(0, 9, 50)))
    figure.savefig(folder / "forecasts.png")
    with RunLog(folder / "evaluation.jsonl", type(RUN)(**(FIELDS | {"stage": "evaluate"})), found) as log:
        log.metrics(0, {"test/log_mse_sum": [-2.0, -1.5], "test/rmse_omega0": [0.1, 0.2]})
        log.artifact(folder / "forecasts.png")
    return found


@pytest.fixture(scope="module")
def results(tracking):
    return Path(tracking.uri.removeprefix("sqlite:///")).parents[1]


@pytest.fixture(scope="module")
def dashboard(results):
    """The command and the link, as the end of a run prints them; the link at the port of this test."""
    command, link = Watch(results, results).where_to_look()[-2:]
    command, link = command.removeprefix("Dashboard: ").removesuffix(", then"), link.removeprefix("  swing: ")
    with browser.served(command) as address:
        yield link.replace("http://127.0.0.1:5000", address)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    found = browser.Page(tmp_path_factory.mktemp("profile"))
    yield found
    found.close()


def run_named(tracking: Tracking, name: str):
    return next(run for run in runs_of(tracking) if run.info.run_name == name)


def page_of(dashboard: str, run, tab: str = "") -> str:
    return f"{dashboard.partition('/runs')[0]}/runs/{run.info.run_id}{tab}?workflowType=machine_learning"


def test_the_link_opens_the_list_of_runs_and_their_charts(dashboard, page, tracking):
    page.open(dashboard, "Hybrid+ · swing", "test/log_mse_sum", "-1.75")
    page.keep("runs")
    page.open(f"{dashboard}&compareRunsMode=CHART", "Hybrid+ · swing")
    page.wait_for(page.charts)
    page.keep("charts")


def test_a_row_of_the_report_leads_to_the_runs_behind_it(dashboard, page, tracking, results):
    path = results / "swing" / "mean" / "seeds_0" / "log.jsonl"
    with RunLog(path, type(RUN)(**FIELDS | {"label": "Mean", "method": "mean"}), tracking) as log:
        log.metrics(0, {"loss": [1.0, 1.0]})
    page.open(dashboard, "Hybrid+ · swing", "Mean · swing")
    rows = [SimpleNamespace(method=method, label=label) for method, label in (("hybrid+", "Hybrid+"), ("mean", "Mean"))]
    links = Dashboard(tracking_of_run(results)).of(Table(["method"], [("", [["Hybrid+"]])]), "swing", rows)
    link = links["", "Hybrid+"]
    page.open(link.replace("http://127.0.0.1:5000", dashboard.partition("/#")[0]), "Hybrid+ · swing")
    page.keep("found")
    assert "Mean · swing" not in page.text()


def test_the_page_of_a_method_shows_mean_spread_parameters_data_and_a_figure(dashboard, page, tracking):
    run = run_named(tracking, "Hybrid+ · swing")
    page.open(
        page_of(dashboard, run), "tables/swing.md", "test/log_mse_sum sd", "-1.75", "training.rate", "swing train"
    )
    page.keep("method")
    page.open(page_of(dashboard, run, "/artifacts/seeds_0_1/forecasts.png"), "forecasts.png")
    page.wait_for(page.images)
    page.keep("figure")


def test_two_runs_are_compared(dashboard, page, tracking):
    found = [run_named(tracking, f"Hybrid+ · seed {seed} · evaluate · swing") for seed in (0, 1)]
    ids = "%22,%22".join(run.info.run_id for run in found)
    experiment = dashboard.partition("/experiments/")[2].partition("/")[0]
    base = dashboard.partition("/experiments/")[0]
    address = f"{base}/compare-runs?runs=[%22{ids}%22]&experiments=[%22{experiment}%22]"
    page.open(address, "Hybrid+ · seed 0", "Hybrid+ · seed 1", "training.rate", "test/log_mse_sum")
    page.keep("compared")


def test_a_curve_moves_while_a_training_runs_and_has_no_gap_after_a_kill(dashboard, page, tracking, results):
    path = results / "swing" / "other" / "seeds_0" / "log.jsonl"
    fields = FIELDS | {"seeds": [0], "label": "Other", "method": "other", "stage": "stuck"}
    job = start(str(path), tracking, fields, 0, code=SLOWLY)
    try:
        page.wait_for(lambda: any(run.info.run_name == "Other · seed 0 · stuck · swing" for run in runs_of(tracking)))
        charts = page_of(dashboard, run_named(tracking, "Other · seed 0 · stuck · swing"), "/model-metrics")
        page.open(charts, "loss")
        page.wait_for(lambda: max(page.points(), default=0) > 1)
        first = max(page.points())
        page.wait_for(lambda: max(page.points()) > first)
        page.keep("moving")
        state = eval(job.stdout.readline())
        assert job.stdout.readline() == "ready\n"
    finally:
        job.send_signal(signal.SIGKILL)
        job.wait()
    with RunLog(path, type(RUN)(**fields), tracking, resume=state) as log:
        for step in range(156, 300):
            log.metrics(step, {"loss": [step]})
    page.open(charts, "loss")
    page.wait_for(lambda: list(range(300)) in [sorted(steps) for steps in page.steps()])
    page.keep("resumed")
