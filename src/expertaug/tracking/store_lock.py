"""The lock of a tracking store, which keeps two jobs from making the same thing in it twice."""

from __future__ import annotations

import fcntl
import hashlib
import logging
import os
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from expertaug.errors import InputError

logger = logging.getLogger(__name__)

TOLD_S = 5.0  # of waiting, after which a line says so
LIMIT_S = 120.0  # making a store takes ten seconds on a slow disk
POLL_S = 0.05


@contextmanager
def locked(uri: str, database: Path | None) -> Iterator[None]:
    """Hold the lock of a store: a file beside a sqlite database, else one in a folder of the user's own.

    Raises:
        InputError: another process held it for two minutes.
    """
    if database is None:
        lock = private_folder() / f"{hashlib.sha256(uri.encode()).hexdigest()[:16]}.lock"
    else:
        database.parent.mkdir(parents=True, exist_ok=True)
        lock = database.with_name(f"{database.name}.lock")
    with lock.open("a") as stream:
        _wait(stream, lock)
        yield


def _wait(stream: IO[str], lock: Path) -> None:
    begun, told = time.monotonic(), False
    while True:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError as error:
            waited = time.monotonic() - begun
            if waited > LIMIT_S:
                found = f"another process has held this lock for {LIMIT_S:.0f} s"
                raise InputError(lock, found, "stop that process, or wait for it and try again") from error
        if waited > TOLD_S and not told:
            told = True
            logger.info("%s: another process holds this lock; waiting for it, up to %.0f s", lock, LIMIT_S)
        time.sleep(POLL_S)


def private_folder() -> Path:
    """A folder that only this user can write to: nobody else may hold, or redirect, a lock in it.

    Raises:
        InputError: neither the home nor the temporary directory has a place for it.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    candidates = [cache / "expertaug", Path(tempfile.gettempdir(), f"expertaug-{os.getuid()}")]
    for folder in candidates:
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            found = folder.lstat()
        except OSError:
            continue
        mine = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
        if mine and os.access(folder, os.W_OK | os.X_OK):
            return folder
    raise InputError(candidates[0], "cannot be used for locks", "make it a folder that you alone can write to")
