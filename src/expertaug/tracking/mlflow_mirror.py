"""The mirror of a run log in an MLflow store: one run per seed below a parent run per method."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import platform
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from expertaug.tracking.mlflow_parent import Parent
from expertaug.tracking.mlflow_store import check_present, connect, database
from expertaug.tracking.store_lock import locked

logger = logging.getLogger(__name__)

# MLflow's own limits (mlflow.utils.validation, 3.17).
METRICS_PER_BATCH = 1000
PARAMS_PER_BATCH = 100
KEY_LENGTH = 250
PARAM_LENGTH = 6000
TAG_LENGTH = 8000
LOGGED_PARAM_LENGTH = 6000
DIGEST_LENGTH = 36

SUPERSEDED, SUFFIX = "expertaug.superseded", " (superseded)"
# Curves whose name alone says too little: what the best pass is chosen by is no score of the tables.
SHOWN = {"validation_score": "selection score - observed window - per dimension"}
TRAININGS = ("train", "finetune", "alternate", "during_training")  # stages whose selection score is that


class Mirror:
    """The MLflow runs of one run log.

    Every method may raise whatever mlflow raises; the caller decides what a failure costs.

    The runs of an earlier log at the same path, which this one replaces, are marked: their tag ``expertaug.superseded``
    is "true", their name says so, and those that a kill left running end as killed.

    Arguments:
        uri, experiment: the address of the tracking store and the name of the MLflow experiment.
        header: the first line of the run log.
        path: the path of the run log; the paths in it are relative to its folder.
        runs: run ids by seed, as an earlier process stored them. A run is found again by its id, else by the log's own
            key (a rebuilt store has other ids), else made.
        replaced: the id of the log that was at this path before, where it is known.
    """

    def __init__(
        self,
        uri: str,
        experiment: str,
        header: Mapping[str, Any],
        path: Path,
        runs: Mapping[str, str] | None = None,
        replaced: str | None = None,
    ) -> None:
        self._uri = uri
        self._client, self._experiment_id = connect(uri, experiment)
        self._header, self._folder = header, path.parent
        self._seeds: list[Any] = list(header["seeds"]) or [None]
        self._stored: dict[str, dict[str, set[int]]] = {}
        self._datasets: set[tuple[str, str]] = set()
        # On a server, another machine may have a results folder of the same name.
        place = (str(path.resolve()),) if database(uri) is not None else (platform.node(), str(path.resolve()))
        self._place = hashlib.sha256(json.dumps(place).encode()).hexdigest()[:32]
        with locked(uri, database(uri)):  # two jobs of one method must not make two parents
            self.parent = self._find_parent()
        self._parent = Parent(self._client, self._experiment_id, self.parent, header)
        self._supersede(f"tags.log_place = '{self._place}'")
        if replaced is not None and replaced.isalnum():  # it was read from a file
            self._supersede(f"tags.log_key LIKE '{replaced}/%'")
        self.runs = {str(seed): self._open(seed, (runs or {}).get(str(seed))) for seed in self._seeds}

    def write(self, lines: Iterable[Mapping[str, Any]]) -> None:
        """Store what the lines of a run log say; steps and datasets that the store has already are left out.

        Raises:
            StoreGone: the database was removed or replaced.
        """
        check_present(self._uri)
        steps = []
        for line in lines:
            event = line.get("event")
            if event is None:
                steps.append(line)
            elif event == "dataset":
                self._log_dataset(line)
            elif event == "artifact":
                self._log_artifact(line)
            elif event == "end":
                self._log_metrics(steps)
                steps = []
                for run in self.runs.values():
                    self._client.set_terminated(run, line["status"], end_time=_milliseconds(line["time"]))
                with locked(self._uri, database(self._uri)):  # jobs that end at once read each other's values
                    self._parent.end(self._header["stage"], _milliseconds(line["time"]))
        self._log_metrics(steps)

    def _supersede(self, condition: str) -> None:
        """Mark the runs for which a condition holds, unless they are this log's own."""
        page = None
        while page is None or page.token:
            page = self._client.search_runs([self._experiment_id], condition, page_token=page and page.token)
            for run in page:
                own = run.data.tags.get("log_key", "").startswith(f"{self._header['id']}/")
                if own or run.data.tags.get(SUPERSEDED) == "true":
                    continue
                if run.info.status == "RUNNING":
                    self._client.set_terminated(run.info.run_id, "KILLED")
                name = f"{run.info.run_name.removesuffix(SUFFIX)}{SUFFIX}"
                self._client.update_run(run.info.run_id, name=name)
                self._client.set_tag(run.info.run_id, SUPERSEDED, "true")

    def _log_metrics(self, lines: list[Mapping[str, Any]]) -> None:
        from mlflow.entities import Metric

        for position, (seed, run) in enumerate(self.runs.items()):
            stored = self._stored.get(seed, {})
            metrics = []
            for line in lines:
                for name, values in line.items():
                    key = self._shown(name)
                    if name in ("step", "time") or line["step"] in stored.get(key, ()):
                        continue
                    value = values[position] if isinstance(values, list) else values
                    metrics.append(Metric(key, float(value), _milliseconds(line["time"]), line["step"]))
            for start in range(0, len(metrics), METRICS_PER_BATCH):
                self._client.log_batch(run, metrics=metrics[start : start + METRICS_PER_BATCH])

    def _shown(self, name: str) -> str:
        return _key(SHOWN.get(name, name) if self._header["stage"] in TRAININGS else name)

    def _log_dataset(self, line: Mapping[str, Any]) -> None:
        from mlflow.entities import Dataset, DatasetInput, InputTag

        digest = line["sha256"][:DIGEST_LENGTH]
        if (line["name"], digest) in self._datasets:
            return
        self._datasets.add((line["name"], digest))
        source = json.dumps({"uri": os.path.normpath(self._folder / line["path"])})
        name, schema = f"{self._header['experiment']} {line['name']}", json.dumps(line.get("schema") or {})
        dataset = Dataset(name, digest, "local", source, schema, json.dumps(line.get("profile") or {}))
        for run in (*self.runs.values(), self.parent):
            self._client.log_inputs(run, [DatasetInput(dataset, [InputTag("mlflow.data.context", line["name"])])])

    def _log_artifact(self, line: Mapping[str, Any]) -> None:
        path = self._folder / line["path"]
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
            name = _model_name(f"{self._header['experiment']} {self._header['label']} seed {seed}")
            tags = {"log_key": self._log_key(seed), "file": os.path.normpath(path), "format": "safetensors"}
            if self._client.search_logged_models([self._experiment_id], f"tags.log_key = '{tags['log_key']}'"):
                continue
            params = {key: value[:LOGGED_PARAM_LENGTH] for key, value in flatten(self._header["params"]).items()}
            made = self._client.create_logged_model(self._experiment_id, name, run, tags, params, "expertaug")
            self._client.finalize_logged_model(made.model_id, LoggedModelStatus.READY)
            self._client.log_outputs(run, [LoggedModelOutput(made.model_id, step=0)])

    def _find_parent(self) -> str:
        header = self._header
        fields = {name: str(header[name]) for name in ("experiment", "method", "label", "system", "preset")}
        names = [fields[name] for name in ("experiment", "label", "preset")]
        key = hashlib.sha256(json.dumps(names).encode()).hexdigest()[:32]
        found = self._client.search_runs(
            [self._experiment_id], f"tags.parent_key = '{key}'", order_by=["attributes.start_time ASC"], max_results=1
        )
        if found:
            return found[0].info.run_id
        return self._create(f"{fields['experiment']}/{fields['label']}", fields | {"parent_key": key})

    def _open(self, seed: Any, run_id: str | None) -> str:
        run = self._get(run_id) or self._search(seed)
        if run is None:
            header = self._header
            name = header["stage"] if seed is None else f"seed {seed} · {header['stage']}"
            fields = ("experiment", "method", "label", "system", "preset", "stage")
            tags = {name: str(header[name]) for name in fields} | dict(header["tags"])
            if seed is not None:
                tags["seed"] = str(seed)
            if "git_revision" in tags:
                tags["mlflow.source.git.commit"] = tags["git_revision"].removesuffix("-dirty")
            tags |= {"mlflow.source.type": "LOCAL", "mlflow.source.name": f"expertaug {header['stage']}"}
            tags |= {"mlflow.parentRunId": self.parent, "log_key": self._log_key(seed), "log_place": self._place}
            run = self._client.get_run(self._create(name, tags))
        elif run.info.status != "RUNNING":
            self._client.update_run(run.info.run_id, status="RUNNING")
        run_id = run.info.run_id
        self._log_params(run_id, seed, run.data.params)
        self._log_params(self.parent, None, self._client.get_run(self.parent).data.params)
        self._stored[str(seed)] = {
            key: {metric.step for metric in self._client.get_metric_history(run_id, key)} for key in run.data.metrics
        }
        if run.inputs is not None and seed == self._seeds[-1]:
            self._datasets = {(i.dataset.name, i.dataset.digest) for i in run.inputs.dataset_inputs}
        return run_id

    def _log_params(self, run_id: str, seed: Any, stored: Mapping[str, str]) -> None:
        from mlflow.entities import Param

        flat = flatten(self._header["params"])
        if seed is not None:
            flat["seed"] = str(seed)
        params = [Param(key, value) for key, value in flat.items() if key not in stored]
        for start in range(0, len(params), PARAMS_PER_BATCH):
            self._client.log_batch(run_id, params=params[start : start + PARAMS_PER_BATCH])

    def _get(self, run_id: str | None) -> Any:
        if run_id is None:
            return None
        try:
            return self._client.get_run(run_id)
        except Exception as error:
            if getattr(error, "error_code", "") == "RESOURCE_DOES_NOT_EXIST":
                return None
            raise

    def _search(self, seed: Any) -> Any:
        found = self._client.search_runs(
            [self._experiment_id], f"tags.log_key = '{self._log_key(seed)}'", max_results=1
        )
        return found[0] if found else None

    def _log_key(self, seed: Any) -> str:
        return f"{self._header['id']}/{seed}"

    def _create(self, name: str, tags: Mapping[str, str]) -> str:
        cut = {_key(key): str(value)[:TAG_LENGTH] for key, value in tags.items()}
        start = _milliseconds(self._header["time"])
        return self._client.create_run(self._experiment_id, start_time=start, tags=cut, run_name=name).info.run_id


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


def _model_name(text: str) -> str:
    return re.sub(r"[/:.%\"']", "_", text)


def _milliseconds(seconds: float) -> int:
    """A time as MLflow holds it, which refuses one before 1970 and takes 0 for none."""
    return max(round(seconds * 1000), 1)
