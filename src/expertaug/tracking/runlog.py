"""The run log: JSON lines, one file per job, mirrored to an MLflow store where one can be reached.

The file is the truth. Its first line is a header that says what ran; each further line is either a step,
``{"step": 3, "time": 1.7e9, "loss": [0.1, 0.2]}`` with one value per seed (or one number for all of them; non-finite
values as the texts "nan", "inf", "-inf"), or an event (a dataset, an artifact, a seed that failed, the end).
"""

from __future__ import annotations

import json
import logging
import os
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

from expertaug import files
from expertaug.errors import InputError
from expertaug.tracking.log_file import Log, number, read_log, table_metrics
from expertaug.tracking.mlflow_mirror import Mirror
from expertaug.tracking.mlflow_store import brief, initialise
from expertaug.tracking.provenance import revision
from expertaug.tracking.rebuild import rebuild

__all__ = ["Log", "RunLog", "initialise", "read_log", "rebuild"]

logger = logging.getLogger(__name__)

RESERVED = {"step", "time", "event"}


class RunLog:
    """Writes one job's log; a context manager that closes it as finished, failed or killed.

    Arguments:
        path: of the JSON lines; overwritten unless ``resume`` is given.
        tracking: ``{"enabled", "uri", "experiment", "tags"}``; None or not enabled: mlflow is not even imported.
        experiment, method, label, system, preset, stage: what runs.
        seeds: that are trained together; the order of every metric's values. Empty: one run without a seed.
        params: the settings, any nesting that JSON holds.
        tags: further texts for the store.
        resume: what :meth:`state` returned before the job was killed.

    Raises:
        InputError: the file cannot be written.
    """

    def __init__(
        self,
        path: str | Path,
        tracking: Mapping[str, Any] | None,
        *,
        experiment: str,
        method: str,
        label: str,
        system: str,
        preset: str,
        stage: str,
        seeds: Sequence[int],
        params: Mapping[str, Any],
        tags: Mapping[str, str] | None = None,
        resume: Mapping[str, Any] | None = None,
    ) -> None:
        self.path = Path(path)
        self._tracking = tracking if tracking is not None and tracking.get("enabled", True) else None
        self._mirror: Any = None
        self._pending: list[dict[str, Any]] = []
        self._closed = False
        tags = {**((tracking or {}).get("tags") or {}), **(tags or {})}
        if "git_revision" not in tags and (commit := revision()):
            tags["git_revision"] = commit
        header = {
            "id": resume["id"] if resume else uuid.uuid4().hex,
            "time": time.time(),
            "experiment": experiment,
            "method": method,
            "label": label,
            "system": system,
            "preset": preset,
            "stage": stage,
            "seeds": [int(seed) for seed in seeds],
            "params": json.loads(json.dumps(params, default=str), parse_constant=str),
            "tags": {key: str(value) for key, value in tags.items()},
        }
        old = _read_if_any(self.path)
        kept = self._keep(old, resume)
        self._header = old.header if kept else header
        self._runs = dict((resume or {}).get("runs") or {})
        self._parent = (resume or {}).get("parent")
        known = dict(self._runs)
        with self._tolerated():
            self._start_mirror()
            if self._mirror and not resume and old is not None:
                self._mirror.abandon(old.header.get("runs") or {})
        with self._written():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("ab" if kept else "wb")
        if not kept:
            self._write({**self._header, "runs": self._runs, "parent": self._parent}, mirrored=False)
        else:
            self._pending = list(_read_if_any(self.path).lines)
            if self._runs != known:  # the store was out of reach, or another one, when the header was written
                self._write({"event": "runs", "runs": self._runs, "parent": self._parent}, mirrored=False)
        self.flush()

    def metrics(self, step: int, values: Mapping[str, Any]) -> None:
        """Add one step.

        Arguments:
            step: counts up; the same metric must not be logged twice at one step.
            values: per metric one number per seed (a sequence, an array or a tensor), or one number for all seeds.

        Raises:
            ValueError: a metric has another number of values than there are seeds, or a reserved name.
        """
        line: dict[str, Any] = {"step": int(step), "time": time.time()}
        for name, value in values.items():
            if name in RESERVED:
                raise ValueError(f"metric {name!r}: the name is reserved")
            if getattr(value, "ndim", 1) == 0 or not hasattr(value, "__len__"):
                line[name] = number(value)
                continue
            line[name] = [number(item) for item in value]
            if len(line[name]) != len(self._header["seeds"]):
                raise ValueError(f"metric {name!r}: {len(line[name])} values for {len(self._header['seeds'])} seeds")
        self._write(line)

    def table(self, path: str | Path) -> None:
        """Add a metrics.csv in long format as step 0: metric ``set/metric`` of each seed."""
        self.metrics(0, table_metrics(path, self._header["seeds"]))

    def dataset(self, name: str, path: str | Path) -> None:
        """Record that the job reads the file ``path`` as data set ``name`` (train, validation, …), with its SHA-256."""
        self._write({"event": "dataset", "name": name, "path": self._relative(path), "sha256": files.sha256(path)})

    def artifact(self, path: str | Path) -> None:
        """Record an output file (model, figure) and copy it to the store."""
        self._write({"event": "artifact", "path": self._relative(path)})

    def event(self, name: str, **fields: Any) -> None:
        """Add a line that is no step: what happened, and to what (fields of plain JSON)."""
        self._write({"event": name, "time": time.time(), **fields})

    def flush(self) -> None:
        """Bring the file to the disk, and to the store what is new.

        Raises:
            InputError: the disk is full.
        """
        with self._written():
            self._file.flush()
            os.fsync(self._file.fileno())
        pending, self._pending = self._pending, []
        if self._mirror is not None and pending:
            with self._tolerated():
                self._mirror.write(pending)

    def state(self) -> dict[str, Any]:
        """What a checkpoint keeps so that the job can go on in this log; flushes first."""
        self.flush()
        return {"id": self._header["id"], "offset": self._file.tell(), "runs": self._runs, "parent": self._parent}

    def close(self, status: str = "FINISHED") -> None:
        """End the log with FINISHED, FAILED or KILLED; the second call does nothing."""
        if self._closed:
            return
        self._closed = True
        self._write({"event": "end", "time": time.time(), "status": status})
        try:
            self.flush()
        finally:
            self._file.close()

    def __enter__(self) -> RunLog:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        failed = kind is not None and issubclass(kind, Exception)
        self.close("FAILED" if failed else "FINISHED" if kind is None else "KILLED")

    def _keep(self, old: Log | None, resume: Mapping[str, Any] | None) -> bool:
        """Cut the file at the checkpoint; False where it is not the checkpoint's file and has to start again."""
        if not resume or old is None or old.header["id"] != resume["id"] or self.path.stat().st_size < resume["offset"]:
            return False
        with self._written():
            os.truncate(self.path, resume["offset"])
        return True

    def _start_mirror(self) -> None:
        if self._tracking is None:
            return
        uri, experiment = self._tracking["uri"], self._tracking["experiment"]
        self._mirror = Mirror(uri, experiment, self._header, self.path.parent, self._runs)
        self._runs, self._parent = dict(self._mirror.runs), self._mirror.parent

    def _write(self, line: Mapping[str, Any], mirrored: bool = True) -> None:
        with self._written():
            self._file.write(json.dumps(line, allow_nan=False, ensure_ascii=False).encode() + b"\n")
        if mirrored and self._mirror is not None:
            self._pending.append(dict(line))

    def _relative(self, path: str | Path) -> str:
        """Relative to the log, so that the results folder can be moved."""
        return os.path.relpath(path, self.path.parent)

    @contextmanager
    def _tolerated(self) -> Iterator[None]:
        """A store that fails costs one warning, and the mirror of the rest of this process."""
        try:
            yield
        except Exception as error:
            self._mirror = None
            uri = (self._tracking or {}).get("uri")
            logger.warning(
                "tracking store %s failed (%s); the run goes on and is logged in %s",
                uri,
                brief(error),
                self.path,
            )

    @contextmanager
    def _written(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            remedy = "free some space or choose a writable results folder"
            raise InputError(self.path, f"cannot be written ({error.strerror})", remedy) from error


def _read_if_any(path: Path) -> Log | None:
    try:
        return read_log(path)
    except InputError:
        return None
