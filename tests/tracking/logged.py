"""A run that logs, in this process or in one of its own, and what a store holds of it."""

from __future__ import annotations

import logging
import subprocess
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path

from expertaug.tracking.log import Run
from expertaug.tracking.settings import InitTrackingJob, Tracking

FIELDS = {
    "experiment": "swing",
    "method": "hybrid+",
    "label": "Hybrid+",
    "system": "pendulum",
    "preset": "corrected",
    "stage": "train",
    "seeds": [0, 1],
    "params": {"training": {"epochs": 3, "rate": 0.001}, "widths": [50, 50], "nothing": None},
}
RUN = Run(**FIELDS)


def settings(folder: Path) -> Tracking:
    return Tracking(enabled=True, uri=f"sqlite:///{folder}/mlflow/mlflow.db", experiment="trial", rule="train")


def initial(tracking: Tracking, experiments: Sequence[str] = ("swing",)) -> InitTrackingJob:
    """What makes a store."""
    fields = {name: getattr(tracking, name) for name in ("enabled", "uri", "experiment")}
    return InitTrackingJob(**fields, experiments=list(experiments))


def elsewhere(tracking: Tracking, **changed: str) -> Tracking:
    """Another store, or another experiment in the same one."""
    return tracking.model_copy(update=changed)


def runs_of(tracking: Tracking) -> list:
    from mlflow.tracking import MlflowClient

    client = MlflowClient(tracking_uri=tracking.uri)
    experiment = client.get_experiment_by_name(tracking.name_of("swing"))
    return client.search_runs([experiment.experiment_id], max_results=1000)


def history(tracking: Tracking, run, key: str) -> list[tuple[int, float, int]]:
    from mlflow.tracking import MlflowClient

    found = MlflowClient(tracking_uri=tracking.uri).get_metric_history(run.info.run_id, key)
    return sorted((metric.step, metric.value, metric.timestamp) for metric in found)


def contents(tracking: Tracking) -> list:
    """All that a store holds, without the ids that every store makes for itself."""
    from mlflow.tracking import MlflowClient

    client = MlflowClient(tracking_uri=tracking.uri)
    found = []
    for run in runs_of(tracking):
        tags = {k: v for k, v in run.data.tags.items() if k not in ("mlflow.parentRunId",)}
        parent = run.data.tags.get("mlflow.parentRunId")
        found.append(
            (
                run.info.run_name,
                (run.info.status, run.info.start_time, run.info.end_time),
                tags,
                client.get_run(parent).info.run_name if parent else "",
                run.data.params,
                {key: history(tracking, run, key) for key in run.data.metrics},
                sorted((i.dataset.name, i.dataset.digest, i.dataset.source) for i in run.inputs.dataset_inputs),
                sorted(item.path for item in client.list_artifacts(run.info.run_id)),
            )
        )
    return sorted(found, key=repr)


WORKER = """
    import sys, time
    from pathlib import Path
    from expertaug.tracking.log import Run
    from expertaug.tracking.run_log import RunLog
    from expertaug.tracking.settings import Tracking
    path, tracking, fields, start = eval(sys.argv[1])
    while time.time() < start: pass
    log = RunLog(path, Run(**fields), tracking)
    for step in range(300):
        log.metrics(step, {"loss": [step] * len(fields["seeds"])})
        if step % 10 == 0: log.flush()
        if step == 155:
            print(repr(log.state()), flush=True)
            if fields["stage"] == "stuck":
                for late in range(156, 190): log.metrics(late, {"loss": [-1] * len(fields["seeds"])})
                log.flush()
                log.metrics(190, {"loss": [-1] * len(fields["seeds"])})
                print("ready", flush=True)
                time.sleep(60)
    log.close()
"""


def start(*arguments, code: str = WORKER, python: str = sys.executable) -> subprocess.Popen:
    command = [python, "-c", textwrap.dedent(code), repr(arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def children_of(tracking: Tracking) -> list:
    return [run for run in runs_of(tracking) if "seed" in run.data.tags]


def told(caplog) -> list[str]:
    """Warnings; what is only progress depends on the level that other tests have set."""
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]
