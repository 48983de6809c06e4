"""The run log: JSON lines, one file per job, mirrored to an MLflow store where one can be reached.

The file is the truth. Its first line is a header that says what ran; each further line is either a step,
``{"step": 3, "time": 1.7e9, "loss": [0.1, 0.2]}`` with one value per seed (or one number for all of them; non-finite
values as the texts "nan", "inf", "-inf"), or an event (a dataset, an artifact, a seed that failed, the end).
"""

from __future__ import annotations

import json
import os
import time
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

from expertaug import files
from expertaug.errors import InputError
from expertaug.tracking.data_file import described
from expertaug.tracking.log_file import Log, number, read_log, table_metrics
from expertaug.tracking.provenance import revision
from expertaug.tracking.run import Run
from expertaug.tracking.store_link import StoreLink

RESERVED = {"step", "time", "event"}


class RunLog:
    """Writes one job's log; a context manager that closes it as finished, failed or killed.

    Arguments:
        path: the path of the JSON lines; overwritten unless ``resume`` is given.
        run: what runs.
        tracking: ``{"enabled", "uri", "experiment", "tags"}``; None or not enabled: mlflow is not even imported.
        resume: what :meth:`state` returned before the job was killed.

    Raises:
        InputError: the file cannot be written.
    """

    def __init__(
        self,
        path: str | Path,
        run: Run,
        tracking: Mapping[str, Any] | None = None,
        resume: Mapping[str, Any] | None = None,
    ) -> None:
        self.path = Path(path)
        self._pending: list[dict[str, Any]] = []
        self._closed = False
        tags = {**((tracking or {}).get("tags") or {}), **run.tags}
        if "git_revision" not in tags and (commit := revision()):
            tags["git_revision"] = commit
        old = _read_if_any(self.path)
        kept = self._keep(old, resume)
        header = replace(run, tags=tags).header(resume["id"] if resume else uuid.uuid4().hex)
        self._header = old.header if kept else header
        self._runs, self._parent = dict((resume or {}).get("runs") or {}), (resume or {}).get("parent")
        with self._written():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("ab" if kept else "wb")
        self._link = None
        if not kept:
            self._write(self._header)
        if tracking is not None and tracking.get("enabled", True):
            replaced = None if old is None or old.header["id"] == self._header["id"] else old.header["id"]
            self._link = StoreLink(tracking, self.path, self._header, self._runs, self._parent, replaced)
        self.flush()  # the header first: by its id the runs are found again that the store is now asked to make

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
        line = {"event": "dataset", "name": name, "path": self._relative(path), "sha256": files.sha256(path)}
        self._write(line | described(Path(path)))

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
        self._to_disk()
        self._to_store(now=False)

    def state(self) -> dict[str, Any]:
        """What a checkpoint keeps so that the job can go on in this log; flushes first."""
        self.flush()
        return {"id": self._header["id"], "offset": self._file.tell(), "runs": self._runs, "parent": self._parent}

    def close(self, status: str = "FINISHED") -> None:
        """End the log with FINISHED, FAILED or KILLED; the second call does nothing."""
        if self._closed:
            return
        self._closed = True
        try:
            self._write({"event": "end", "time": time.time(), "status": status})
            self._to_disk()
            self._to_store(now=status != "KILLED")  # who interrupts a job is not to wait for a store
            if self._link is not None:
                self._link.end()
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

    def _write(self, line: Mapping[str, Any]) -> None:
        with self._written():
            self._file.write(json.dumps(line, allow_nan=False, ensure_ascii=False).encode() + b"\n")
        self._pending.append(dict(line))

    def _to_disk(self) -> None:
        with self._written():
            self._file.flush()
            os.fsync(self._file.fileno())

    def _to_store(self, now: bool) -> None:
        pending, self._pending = self._pending, []
        if self._link is None:
            return
        self._link.send(pending, now)
        if self._link.runs != self._runs and not self._closed:
            self._runs, self._parent = dict(self._link.runs), self._link.parent
            self._write({"event": "runs", "runs": self._runs, "parent": self._parent})
            self._to_disk()

    def _relative(self, path: str | Path) -> str:
        """Relative to the log, so that the results folder can be moved."""
        return os.path.relpath(path, self.path.parent)

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
