"""Bringing an MLflow store up to date with a run log, from where it stands: one run per seed below a parent per method.

What the store has already is found there by the log's id and left out, so that the same log may be given again, longer
or not: while it is written, after a kill, after a failure of the store, and into an empty store.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import platform
import re
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from expertaug.files import is_inside
from expertaug.tracking.log import Artifact, Dataset, End, Header, Line, Step, read_lines, read_log
from expertaug.tracking.settings import Tracking
from expertaug.tracking.store import StoreGone, brief, check_present, connect, database, lock_store, rebuild_command

logger = logging.getLogger(__name__)

# MLflow's own limits (mlflow.utils.validation, 3.17).
METRICS_PER_BATCH = 1000
PARAMS_PER_BATCH = 100
KEY_LENGTH = 250
PARAM_LENGTH = 6000
TAG_LENGTH = 8000
DIGEST_LENGTH = 36

FIRST_WAIT_S, LONGEST_WAIT_S = 30.0, 600.0
SUPERSEDED, SUFFIX = "expertaug.superseded", " (superseded)"
# Curves whose name alone says too little: what the best pass is chosen by is no score of the tables.
SHOWN = {"validation_score": "selection score - observed window - per dimension"}
TRAININGS = ("train", "finetune", "alternate", "during_training")  # stages whose selection score is that
WORST_FIRST = ("FAILED", "KILLED", "RUNNING", "SCHEDULED")
SPREAD = " sd"  # of a metric's name: its standard deviation over seeds
IDENTITY = ("experiment", "method", "label", "system", "preset")
NOTE = f"""Each metric is the mean of the scores of this method's runs below, over {{count}} seeds;
`NAME{SPREAD}` is their standard deviation. Logarithms are natural and of mean squared errors, `rmse_NAME` has the unit
of NAME, `relative_error` is in percent. The table with these numbers is `{{table}}` in the results folder.
"""


class Sync:
    """Keeps a store up to date with a log; a failure costs a warning and some waiting, never the job.

    Arguments:
        path: the run log, which has its header.
        tracking: the store.

    Attributes:
        runs: ids of the log's runs by seed, and of its ``parent``, as long as the store works.
    """

    def __init__(self, path: Path, tracking: Tracking) -> None:
        self._path, self._tracking = path, tracking
        self._mirror: Mirror | None = None
        self._offset = 0
        self._next, self._wait = 0.0, FIRST_WAIT_S  # when a broken connection is tried again
        self._warned = False

    @property
    def runs(self) -> dict[str, str] | None:
        return None if self._mirror is None else {**self._mirror.runs, "parent": self._mirror.parent}

    def update(self, now: bool = False) -> None:
        """Store what is new in the log; ``now``: also where the store failed a moment ago."""
        if self._mirror is None and not now and time.monotonic() < self._next:
            return
        try:
            if self._mirror is None:
                log = read_log(self._path)
                self._mirror = Mirror(self._tracking, log.header, self._path)
                lines, self._offset = log.lines, log.size
                if self._warned:
                    logger.info("tracking store %s answers again", self._tracking.uri)
            else:
                lines, self._offset = read_lines(self._path, self._offset)
            self._mirror.write(lines)
            self._wait = FIRST_WAIT_S
        except Exception as error:
            self._failed(error)

    def finish(self, patient: bool = True) -> dict[str, str] | None:
        """Store what is left, and say how to mend a store that lacks lines of the log, which is complete.

        Arguments:
            patient: ask a store again that just failed, which is no reason yet to give up.
        """
        worked = self._mirror is not None
        self.update(now=patient)
        if self._mirror is None and patient and worked:
            self.update(now=True)
        if self._mirror is None:
            uri, experiment = self._tracking.uri, self._tracking.experiment
            command = rebuild_command(uri, experiment, self._path)
            logger.warning("tracking store %s lacks part of %s; once it works: %s", uri, self._path, command)
        return self.runs

    def _failed(self, error: Exception) -> None:
        self._mirror = None  # whatever half of the lines it has: the next one finds out
        # A database that is gone cannot come back: MLflow keeps the old one open as long as the process lives.
        self._next = float("inf") if isinstance(error, StoreGone) else time.monotonic() + self._wait
        self._wait = min(2 * self._wait, LONGEST_WAIT_S)
        if not self._warned:
            self._warned = True
            text = "tracking store %s failed (%s); the run goes on and is logged in %s"
            logger.warning(text, self._tracking.uri, brief(error), self._path)


class Mirror:
    """The MLflow runs of one run log, found by the log's id, else made.

    Every method may raise whatever mlflow raises.

    The runs of an earlier log at the same path, which this one replaces, are marked: their tag ``expertaug.superseded``
    is "true", their name says so, and those that a kill left running end as killed.

    Arguments:
        tracking: the store.
        header: the first line of the log.
        path: of the log; the paths in it are relative to its folder.

    Attributes:
        runs: ids by seed.
        parent: id of the run above those of all the method's seeds.
    """

    def __init__(self, tracking: Tracking, header: Header, path: Path) -> None:
        self._uri, self._header, self._folder = tracking.uri, header, path.parent
        self._client, self._experiment_id = connect(tracking.uri, tracking.name_of(header.experiment))
        # On a server, another machine may have a results folder of the same name.
        place = (str(path.resolve()),) if database(self._uri) is not None else (platform.node(), str(path.resolve()))
        self._place = _digest(place)
        with lock_store(self._uri):  # two jobs of one method must not make two parents
            self.parent = self._find_parent()
        self._supersede(f"tags.log_place = '{self._place}'")
        if header.replaces is not None and header.replaces.isalnum():  # it was read from a file
            self._supersede(f"tags.log_key LIKE '{header.replaces}/%'")
        self._stored: dict[str, dict[str, set[int]]] = {}
        self._datasets: set[tuple[str, str]] = set()
        self.runs = {str(seed): self._open(seed) for seed in (header.seeds or (None,))}
        self._log_params(self.parent, None)

    def write(self, lines: Iterable[Line]) -> None:
        """Store what the lines of the log say, but for what the store has.

        Raises:
            StoreGone: the database was removed or replaced.
        """
        check_present(self._uri)
        steps = []
        for line in lines:
            if isinstance(line, Step):
                steps.append(line)
            elif isinstance(line, Dataset):
                self._log_dataset(line)
            elif isinstance(line, Artifact):
                self._log_artifact(line)
            elif isinstance(line, End):
                self._log_metrics(steps)
                steps = []
                for run in self.runs.values():
                    self._client.set_terminated(run, line.status, end_time=_milliseconds(line.time))
                with lock_store(self._uri):  # jobs that end at once read each other's values
                    self._end_parent(_milliseconds(line.time))
        self._log_metrics(steps)

    def _open(self, seed: int | None) -> str:
        """The run of a seed, made if it is not there, and what it has already."""
        header, log_key = self._header, self._log_key(seed)
        run = next(self._search(f"tags.log_key = '{log_key}'"), None)
        if run is None:
            tags = {name: getattr(header, name) for name in (*IDENTITY, "stage")} | header.tags
            if seed is not None:
                tags["seed"] = str(seed)
            if "git_revision" in tags:
                tags["mlflow.source.git.commit"] = tags["git_revision"].removesuffix("-dirty")
            tags |= {"mlflow.source.type": "LOCAL", "mlflow.source.name": f"expertaug {header.stage}"}
            tags |= {"mlflow.parentRunId": self.parent, "log_key": log_key, "log_place": self._place}
            run = self._client.get_run(self._create(self._name(seed), tags))
        elif run.info.status != "RUNNING":
            self._client.update_run(run.info.run_id, status="RUNNING")
        run_id = run.info.run_id
        self._log_params(run_id, seed, run.data.params)
        histories = {key: self._client.get_metric_history(run_id, key) for key in run.data.metrics}
        self._stored[str(seed)] = {key: {metric.step for metric in points} for key, points in histories.items()}
        if run.inputs is not None:
            self._datasets = {(i.dataset.name, i.dataset.digest) for i in run.inputs.dataset_inputs}
        return run_id

    def _create(self, name: str, tags: Mapping[str, str]) -> str:
        cut = {_key(key): value[:TAG_LENGTH] for key, value in tags.items()}
        start = _milliseconds(self._header.time)
        return self._client.create_run(self._experiment_id, start_time=start, tags=cut, run_name=name).info.run_id

    def _search(self, condition: str, **how: Any) -> Iterator[Any]:
        page = None
        while page is None or page.token:
            page = self._client.search_runs([self._experiment_id], condition, page_token=page and page.token, **how)
            yield from page

    def _log_key(self, seed: int | str | None) -> str:
        return f"{self._header.id}/{seed}"

    def _supersede(self, condition: str) -> None:
        """Mark the runs for which a condition holds, unless they are this log's own."""
        for run in list(self._search(condition)):
            own = run.data.tags.get("log_key", "").startswith(f"{self._header.id}/")
            if own or run.data.tags.get(SUPERSEDED) == "true":
                continue
            if run.info.status == "RUNNING":
                self._client.set_terminated(run.info.run_id, "KILLED")
            self._client.update_run(run.info.run_id, name=f"{run.info.run_name.removesuffix(SUFFIX)}{SUFFIX}")
            self._client.set_tag(run.info.run_id, SUPERSEDED, "true")

    def _log_params(self, run_id: str, seed: int | None, stored: Mapping[str, str] | None = None) -> None:
        from mlflow.entities import Param

        stored = self._client.get_run(run_id).data.params if stored is None else stored
        flat = flatten(self._header.params) | ({} if seed is None else {"seed": str(seed)})
        params = [Param(key, value) for key, value in flat.items() if key not in stored]
        for part in _parts(params, PARAMS_PER_BATCH):
            self._client.log_batch(run_id, params=part)

    def _log_metrics(self, lines: Sequence[Step]) -> None:
        from mlflow.entities import Metric

        for position, (seed, run) in enumerate(self.runs.items()):
            stored = self._stored[seed]
            metrics = []
            for line in lines:
                for name, values in line.metrics.items():
                    key = _key(SHOWN.get(name, name) if self._header.stage in TRAININGS else name)
                    if line.step not in stored.get(key, ()):
                        value = values[position] if isinstance(values, tuple) else values
                        metrics.append(Metric(key, value, _milliseconds(line.time), line.step))
            for part in _parts(metrics, METRICS_PER_BATCH):
                self._client.log_batch(run, metrics=part)

    def _log_dataset(self, line: Dataset) -> None:
        from mlflow.entities import Dataset as Entity
        from mlflow.entities import DatasetInput, InputTag

        name, digest = f"{self._header.experiment} {line.name}", line.sha256[:DIGEST_LENGTH]
        if (name, digest) in self._datasets:
            return
        self._datasets.add((name, digest))
        source = json.dumps({"uri": os.path.normpath(self._folder / line.path)})
        entity = Entity(name, digest, "local", source, json.dumps(line.tensors or {}), json.dumps(line.profile or {}))
        for run in (self.parent, *self.runs.values()):  # the last one's tell what all have
            self._client.log_inputs(run, [DatasetInput(entity, [InputTag("mlflow.data.context", line.name)])])

    def _log_artifact(self, line: Artifact) -> None:
        path = self._folder / line.path
        if not is_inside(path, self._folder):
            logger.warning("%s: not in the folder of the log that names it, so it is no artifact of its run", path)
            return
        if not path.is_file():  # a log may outlive the file; the run is no worse for it
            logger.warning("%s: no such file, so it is no artifact of its run", path)
            return
        for run in self.runs.values():
            self._client.log_artifact(run, str(path))
        if path.suffix in (".png", ".csv"):
            self._client.log_artifact(self.parent, str(path), self._folder.name)
        elif path.suffix == ".safetensors":
            self._register(path)

    def _register(self, path: Path) -> None:
        """List a file of tensors among the models of its runs; nothing is pickled, nothing is run to load it."""
        from mlflow.entities import LoggedModelOutput, LoggedModelStatus

        for seed, run in self.runs.items():
            text = f"{self._header.experiment} {self._header.label} seed {seed}"
            tags = {"log_key": self._log_key(seed), "file": os.path.normpath(path), "format": "safetensors"}
            if self._client.search_logged_models([self._experiment_id], f"tags.log_key = '{tags['log_key']}'"):
                continue
            name, params = re.sub(r"[/:.%\"']", "_", text), flatten(self._header.params)
            made = self._client.create_logged_model(self._experiment_id, name, run, tags, params, "expertaug")
            self._client.finalize_logged_model(made.model_id, LoggedModelStatus.READY)
            for run_id in (run, self.parent):
                self._client.log_outputs(run_id, [LoggedModelOutput(made.model_id, step=0)])

    def _find_parent(self) -> str:
        header = self._header
        key = _digest((header.experiment, header.label, header.preset))
        condition = f"tags.parent_key = '{key}'"
        for run in self._search(condition, order_by=["attributes.start_time ASC"], max_results=1):
            return run.info.run_id
        tags = {name: getattr(header, name) for name in IDENTITY} | {"parent_key": key}
        tags |= {"mlflow.source.type": "LOCAL", "mlflow.source.name": "expertaug"}
        return self._create(f"{header.label} · {header.experiment}", tags)

    def _name(self, seed: int | None) -> str:
        """What a run is called: what differs most often first, since lists and comparisons show the beginning alone."""
        header = self._header
        of_seed = () if seed is None else (f"seed {seed}",)
        return " · ".join((header.label, *of_seed, header.stage, header.experiment))

    def _is_score(self, name: str) -> bool:
        """Whether a mean over seeds says something: that of a loss or a learning rate does not."""
        return self._header.stage not in TRAININGS or "/" in name or name in SHOWN.values()

    def _end_parent(self, end: int) -> None:
        """A log has ended, at ``end`` in ms: its parent gets mean and spread of this stage's values, and a state."""
        from mlflow.entities import Metric

        children = self._search(f"tags.mlflow.parentRunId = '{self.parent}'")
        children = [run for run in children if run.data.tags.get(SUPERSEDED) != "true"]
        of_stage = [run for run in children if run.data.tags.get("stage") == self._header.stage]
        metrics = []
        names = {name for run in of_stage for name in run.data.metrics}
        for name in sorted(filter(self._is_score, names)):
            values = [run.data.metrics[name] for run in of_stage if name in run.data.metrics]
            metrics.append(Metric(name, float(np.mean(values)), end, 0))
            if len(values) > 1:
                metrics.append(Metric(f"{name}{SPREAD}", float(np.std(values, ddof=1)), end, 0))
        for part in _parts(metrics, METRICS_PER_BATCH):
            self._client.log_batch(self.parent, metrics=part)
        note = NOTE.format(count=len(of_stage), table=f"tables/{self._header.experiment}.md")
        self._client.set_tag(self.parent, "mlflow.note.content", note)
        states = {run.info.status for run in children}
        worst = next((state for state in WORST_FIRST if state in states), "FINISHED")
        if worst == "RUNNING":
            self._client.update_run(self.parent, status=worst)
        elif worst != "FINISHED" or (self._client.get_run(self.parent).info.end_time or 0) < end:
            self._client.set_terminated(self.parent, worst, end_time=end)


def flatten(params: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """Nested settings as MLflow params: keys joined by dots, values as text cut at MLflow's limit."""
    flat: dict[str, str] = {}
    for key, value in params.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping) and value:
            flat |= flatten(value, f"{name}.")
        else:
            text = value if isinstance(value, str) else json.dumps(value, default=str, ensure_ascii=False)
            flat[_key(name)] = text[:PARAM_LENGTH]
    return flat


def _key(name: str) -> str:
    return re.sub(r"[^\w\-. :/]", "_", name)[:KEY_LENGTH]


def _digest(names: Sequence[str]) -> str:
    return hashlib.sha256(json.dumps(names).encode()).hexdigest()[:32]


def _parts(items: list[Any], size: int) -> Iterator[list[Any]]:
    return (items[start : start + size] for start in range(0, len(items), size))


def _milliseconds(seconds: float) -> int:
    """A time as MLflow holds it, which refuses one before 1970 and takes 0 for none."""
    return max(round(seconds * 1000), 1)
