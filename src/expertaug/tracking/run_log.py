"""Writing a run log: one file of JSON lines per job, mirrored to an MLflow store where one can be reached."""

from __future__ import annotations

import json
import logging
import math
import os
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, SupportsFloat, TypedDict

from expertaug import files
from expertaug.errors import InputError
from expertaug.tracking.log import Artifact, Dataset, End, Event, Header, Record, Run, Status, read_log
from expertaug.tracking.metrics_csv import metrics_by_seed
from expertaug.tracking.provenance import revision
from expertaug.tracking.settings import Tracking
from expertaug.tracking.sync import Sync

logger = logging.getLogger(__name__)

RESERVED = {"step", "time", "event"}


class Position(TypedDict):
    """Where a log stood at a checkpoint: its id, and its length in bytes."""

    id: str
    offset: int


class RunLog:
    """Writes one job's log; a context manager that closes it as finished, failed or killed.

    Arguments:
        path: the path of the JSON lines; overwritten unless ``resume`` is given.
        run: what runs.
        tracking: the store; None or not enabled: mlflow is not even imported.
        resume: what :meth:`state` returned before the job was killed.

    Attributes:
        continued: whether lines of before the kill are kept.

    Raises:
        InputError: the file cannot be written.
    """

    def __init__(
        self, path: str | Path, run: Run, tracking: Tracking | None = None, resume: Position | None = None
    ) -> None:
        self.path = Path(path)
        self._closed = False
        old = _header_if_any(self.path)
        lost = None if resume is None else self._cut(old, resume)
        self.continued = resume is not None and old is not None and old.id == resume["id"]
        with self._written():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("ab" if self.continued else "wb")
        if old is not None and self.continued:
            self._header = old
        else:
            tags = {} if tracking is None or tracking.rule is None else {"rule": tracking.rule}
            if "git_revision" not in run.tags and (commit := revision()):
                tags["git_revision"] = commit
            identity = uuid.uuid4().hex if resume is None else resume["id"]
            replaces = None if old is None or old.id == identity else old.id
            self._header = Header.begin(run, identity, replaces, tags)
            self._write(self._header)
        if lost is not None:
            logger.warning("%s: %s: the curves lack what was logged there", self.path, lost)
            self.event("lines_lost", reason=lost)
        self._sync = None if tracking is None or not tracking.enabled else Sync(self.path, tracking)
        self.flush()  # the header first: by its id the runs are found again that the store is now asked to make

    def metrics(self, step: int, values: Mapping[str, SupportsFloat | Iterable[SupportsFloat]]) -> None:
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
                line[name] = _number(value)
                continue
            line[name] = [_number(item) for item in value]
            if len(line[name]) != len(self._header.seeds):
                raise ValueError(f"metric {name!r}: {len(line[name])} values for {len(self._header.seeds)} seeds")
        self._write(line)

    def table(self, path: str | Path) -> None:
        """Add a metrics.csv in long format as step 0: metric ``set/metric`` of each seed."""
        self.metrics(0, metrics_by_seed(path, self._header.seeds))

    def dataset(self, name: str, path: str | Path) -> None:
        """Record that the job reads the file ``path`` as data set ``name`` (train, validation, …), with its SHA-256."""
        fields = {"name": name, "path": self._relative(path), "sha256": files.sha256(path)}
        self._write(Dataset(**fields, **describe_data(Path(path))))

    def artifact(self, path: str | Path) -> None:
        """Record an output file (model, figure) of the log's folder and copy it to the store."""
        self._write(Artifact(path=self._relative(path)))

    def event(self, name: str, **fields: Any) -> None:
        """Add a line that is no step: what happened, and to what (fields of plain JSON)."""
        self._write(Event(event=name, time=time.time(), **fields))

    def flush(self) -> None:
        """Bring the file to the disk, and to the store what is new.

        Raises:
            InputError: the disk is full.
        """
        self._to_disk()
        if self._sync is not None:
            self._sync.update()

    def state(self) -> Position:
        """What a checkpoint keeps so that the job can go on in this log; flushes first."""
        self.flush()
        return {"id": self._header.id, "offset": self._file.tell()}

    def close(self, status: Status = "FINISHED") -> None:
        """End the log; the second call does nothing."""
        if self._closed:
            return
        self._closed = True
        try:
            self._write(End(time=time.time(), status=status))
            self._to_disk()
            if self._sync is not None:
                self._sync.finish(patient=status != "KILLED")  # who interrupts a job is not to wait for a store
        finally:
            self._file.close()

    def __enter__(self) -> RunLog:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        failed = kind is not None and issubclass(kind, Exception)
        self.close("FAILED" if failed else "FINISHED" if kind is None else "KILLED")

    def _cut(self, old: Header | None, resume: Position) -> str | None:
        """Cut the file where it stood at the checkpoint; says what of it is lost, where something is."""
        if old is None or old.id != resume["id"]:
            what = "was removed or damaged" if old is None else "is another run's"
            return f"the log of the part before this job was stopped {what}"
        with self._written(), self.path.open("r+b") as stream:
            kept = stream.read(resume["offset"])
            whole = kept.rfind(b"\n") + 1
            stream.truncate(whole)
        return (
            None if whole == resume["offset"] else f"cut after {whole} of {resume['offset']} bytes while it was stopped"
        )

    def _write(self, line: Record | Mapping[str, Any]) -> None:
        fields = line.model_dump(by_alias=True, exclude_none=True) if isinstance(line, Record) else line
        with self._written():
            self._file.write(json.dumps(fields, allow_nan=False, ensure_ascii=False).encode() + b"\n")

    def _to_disk(self) -> None:
        with self._written():
            self._file.flush()
            os.fsync(self._file.fileno())

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


def describe_data(path: Path) -> dict[str, Any]:
    """``{"schema", "profile"}`` of an npz, in MLflow's words, without reading its numbers; empty for any other file.

    The schema has its tensors with their names, types and shapes, the profile the number of samples (of ``y``).
    """
    tensors, samples = [], None
    for name, (shape, dtype) in files.npz_headers(path).items():
        tensors.append({"name": name, "type": "tensor", "tensor-spec": {"dtype": dtype.name, "shape": list(shape)}})
        samples = shape[0] if name == "y" else samples
    described = {"schema": {"mlflow_tensorspec": {"features": tensors, "targets": None}}} if tensors else {}
    return described | ({} if samples is None else {"profile": {"num_rows": samples}})


def _header_if_any(path: Path) -> Header | None:
    try:
        return read_log(path).header
    except InputError:
        return None


def _number(value: Any) -> float | str:
    """A number as JSON holds it: non-finite ones as text that ``float`` reads."""
    value = float(value)
    return value if math.isfinite(value) else str(value)
