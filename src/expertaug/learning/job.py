"""A training as a job of the workflow: locked, logged, resumed after a kill, its best state written as a model file."""

from __future__ import annotations

import hashlib
import io
import json
import logging
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

import torch
from pydantic import JsonValue

from expertaug import files, source_files
from expertaug.errors import InputError
from expertaug.files import atomic, sha256
from expertaug.learning import snapshots
from expertaug.learning.settings import named_modules
from expertaug.learning.snapshots import Snapshot
from expertaug.learning.trainer import Progress, State
from expertaug.models import store
from expertaug.models.card import ModelCard
from expertaug.settings import Settings
from expertaug.tracking.log import Run
from expertaug.tracking.run_log import RunLog
from expertaug.tracking.settings import Tracking

logger = logging.getLogger(__name__)

MAGIC = b"expertaug-checkpoint-2"


class Job(Progress):
    """The progress of a training in files: ``log.jsonl`` and snapshots beside the model file, a checkpoint elsewhere.

    A context manager: it holds the job's lock, closes the log as finished, failed or killed, and removes the checkpoint
    when all is well.

    Arguments:
        output: model file.
        work: folder for checkpoints.
        inputs: files that the training depends on: a checkpoint of others is not used.
        settings: of the stage; a checkpoint of others is not used.
        tracking: see :class:`RunLog`.
        module: of the stage, whose files a checkpoint stands for.
    """

    def __init__(
        self,
        output: Path,
        work: Path,
        inputs: Sequence[Path],
        settings: Settings,
        tracking: Tracking | None,
        module: str,
    ) -> None:
        self.output, self.work, self.inputs = Path(output), Path(work), list(inputs)
        self.settings, self.tracking, self.module = settings, tracking, module
        self._open = ExitStack()
        self._kept: Mapping[int, Snapshot] | None = None

    def __enter__(self) -> Self:
        self._open.enter_context(lock_job(self.work))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.__exit__(kind, error, trace)

    def begin(self, card: ModelCard) -> State | None:
        self._card, settings = card, self.settings.to_json()
        wanted = {k: v for k, v in settings.items() if k != "device"}
        named = named_modules(card.system_name, card.model.to_json(), card.objective)
        self._checkpoint = Checkpoint(self.work, fingerprint(wanted, self.inputs, [self.module, *named]))
        self._open.push(self._remove_checkpoint)
        state = self._checkpoint.load()
        run = Run(
            experiment=card.experiment,
            method=card.method,
            label=card.label,
            preset=card.preset,
            stage=card.stage,
            system=card.system_name,
            seeds=tuple(card.seeds),
            params={k: v for k, v in settings.items() if k not in ("seeds", "label")},
            tags={"fingerprint": self._checkpoint.fingerprint},
        )
        resume = None if state is None else state.pop("log")
        self._log = self._open.enter_context(RunLog(self.output.with_name("log.jsonl"), run, self.tracking, resume))
        if not self._log.continued:
            for path in self.inputs:
                self._log.dataset(path.stem, path)
        return state

    def metrics(self, step: int, values: Mapping[str, list[float]]) -> None:
        self._log.metrics(step, values)

    def event(self, name: str, **values: object) -> None:
        self._log.event(name, **values)

    def flush(self) -> None:
        self._log.flush()

    def save(self, state: State) -> None:
        self._checkpoint.save(state | {"log": self._log.state()})

    def snapshots(self, snapshots: Mapping[int, Snapshot]) -> None:
        self._kept = snapshots

    def write(self, stored: store.StoredModel) -> None:
        """Write the model file, and beside it the snapshots, where the training kept some."""
        if self._kept is not None:
            card = self._card.but(failed=stored.failed)
            snapshots.save(self.output.with_name(snapshots.NAME), self._kept, card)
        store.save(self.output, stored.model, stored.card)
        self._log.artifact(self.output)

    def _remove_checkpoint(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._checkpoint.remove()


def fingerprint(settings: Mapping[str, JsonValue], inputs: Iterable[Path], modules: Iterable[str]) -> str:
    """SHA-256 of what a job's result depends on: a checkpoint of another one is not used.

    Arguments:
        settings: of the job.
        inputs: files that it reads.
        modules: of its stage, then those that its settings name
            (:func:`expertaug.learning.settings.named_modules`); they stand for all the files that the workflow
            declares for the stage and for the installed numeric packages.
    """
    modules = list(modules)
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True, default=str).encode())
    for text in source_files.versions(modules):
        digest.update(text.encode())
    for content in [*sorted(map(sha256, source_files.files(modules))), *map(sha256, inputs)]:
        digest.update(content.encode())
    return digest.hexdigest()


class Checkpoint:
    """One file under ``work``, written atomically; removed when the job is done.

    Arguments:
        work: folder of the job, made when needed.
        fingerprint: what the job is made of; a file with another one is ignored.
    """

    def __init__(self, work: Path, fingerprint: str) -> None:
        self.work, self.fingerprint = Path(work), fingerprint
        self.file = self.work / "checkpoint.pt"

    def save(self, state: State) -> None:
        """Write ``state`` and a digest of it."""
        buffer = io.BytesIO()  # torch.save hides what the system says about a full disk
        torch.save(state, buffer)
        with atomic(self.file) as temporary, temporary.open("wb") as stream:
            fingerprint = self.fingerprint.encode()
            stream.write(b" ".join((MAGIC, fingerprint, _digest(fingerprint, buffer.getbuffer()))) + b"\n")
            stream.write(buffer.getbuffer())

    def load(self) -> State | None:
        """The state of an earlier, killed run of the same job; None where there is none that fits.

        A damaged file is a warning: the job starts afresh.

        Raises:
            InputError: it is no file.
        """
        try:
            head, _, payload = self.file.read_bytes().partition(b"\n")
            magic, fingerprint, digest = head.split(b" ")
            if magic != MAGIC or digest != _digest(fingerprint, payload):
                raise ValueError(head)
            if fingerprint != self.fingerprint.encode():
                return None
            return torch.load(io.BytesIO(payload), weights_only=True)
        except FileNotFoundError:
            return None
        except IsADirectoryError as error:
            raise InputError(self.file, "is a folder", "remove it: a checkpoint is written there") from error
        except Exception:  # torch raises many kinds for a damaged file; the remedy is the same
            logger.warning("%s: damaged, so it is not used: the training starts afresh", self.file)
            return None

    def remove(self) -> None:
        """The job's output is written: nothing to resume."""
        shutil.rmtree(self.work, ignore_errors=True)


def _digest(fingerprint: bytes, payload: bytes | memoryview) -> bytes:
    digest = hashlib.sha256(fingerprint)
    digest.update(payload)
    return digest.hexdigest().encode()


@contextmanager
def lock_job(work: Path) -> Iterator[None]:
    """Hold the job's lock, a file beside ``work``: a killed workflow may leave its job running.

    Raises:
        InputError: another process holds it.
    """
    lock = Path(work).with_name(f"{Path(work).name}.lock")
    with files.lock_file(lock, held="another process is running this job"):
        yield
