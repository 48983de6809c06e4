"""Checkpoints of a running job: a killed job goes on to the same bits."""

from __future__ import annotations

import hashlib
import io
import json
import logging
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import torch

from expertaug import files, source_files
from expertaug.errors import InputError
from expertaug.files import atomic, sha256

logger = logging.getLogger(__name__)

MAGIC = b"expertaug-checkpoint-2"


def fingerprint(settings: Mapping, inputs: Iterable[Path], modules: Iterable[str]) -> str:
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

    def save(self, state: dict) -> None:
        """Write ``state`` (tensors, numbers, text, and lists and dicts of them) and a digest of it."""
        buffer = io.BytesIO()  # torch.save hides what the system says about a full disk
        torch.save(state, buffer)
        with atomic(self.file) as temporary, temporary.open("wb") as stream:
            fingerprint = self.fingerprint.encode()
            stream.write(b" ".join((MAGIC, fingerprint, _digest(fingerprint, buffer.getbuffer()))) + b"\n")
            stream.write(buffer.getbuffer())

    def load(self) -> dict | None:
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
def locked(work: Path) -> Iterator[None]:
    """Hold the job's lock, a file beside ``work``: a killed workflow may leave its job running.

    Raises:
        InputError: another process holds it.
    """
    lock = Path(work).with_name(f"{Path(work).name}.lock")
    with files.locked(lock, held="another process is running this job"):
        yield
