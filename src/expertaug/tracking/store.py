"""The MLflow store: made once, shared by all processes.

mlflow takes more than a second to import, so it is imported only inside the functions that need it.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import re
import shlex
import sqlite3
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from expertaug import files
from expertaug.errors import InputError
from expertaug.tracking.settings import VIEW, InitTrackingJob

logger = logging.getLogger(__name__)

# A server that does not answer must not hold up a training; what the user sets wins.
_ENVIRONMENT = {
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "5",
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "1",
    "MLFLOW_HTTP_REQUEST_BACKOFF_FACTOR": "1",
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_LOGGING_LEVEL": "WARNING",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",
}
_NETWORK_FILE_SYSTEMS = re.compile(r"nfs|cifs|smb|lustre|gpfs|beegfs|ceph|gluster|afs|9p|fuse|orangefs|pvfs|drvfs")

# The columns of an experiment's list of runs, as MLflow keeps a view that somebody has shared; its link names it. Those
# that no run has are not shown.
SCORES = [f"{name}/log_mse_{how}" for how in ("sum", "dim") for name in ("validation", "iid", "test")]
COLUMNS = [f"metrics.`{name}`" for name in (*SCORES, "test/relative_error")] + ["attributes.`Models`"]

LOCK_S = 120.0  # making a store takes ten seconds on a slow disk

# The database file that this process opened first, by path: MLflow keeps it open, even when another takes its name.
_opened: dict[Path, tuple[int, int]] = {}


class StoreGone(Exception):
    """The database of a store was removed or replaced since this process opened it: what is written is lost."""


def initialise(job: InitTrackingJob, marker: Path) -> None:
    """Create or upgrade the store and its experiments, once, before any process logs to it.

    A store that cannot be used is a warning: trainings then write their JSON lines only.

    Arguments:
        job: the tracking store, ``sqlite:///results/mlflow/mlflow.db`` or ``http://…``, and the experiments of the
            configuration. A local store's artifacts lie in ``artifacts`` beside the database.
        marker: the path of the JSON file that logging stages read (:class:`Tracking`), written at the end.

    Raises:
        InputError: the marker cannot be written.
    """
    if not job.enabled:
        files.write_json(marker, {"enabled": False})
        return
    identities = None
    try:
        identities = {name: connect(job.uri, job.name_of(name), prepare=True)[1] for name in job.experiments}
    except Exception as error:
        text = "tracking store %s cannot be used (%s); runs are logged to their JSON lines only"
        logger.warning(text, job.uri, brief(error))
    files.write_json(marker, job.model_dump() | {"experiments": identities})


def connect(uri: str, experiment: str, prepare: bool = False) -> tuple[Any, str]:
    """An ``MlflowClient`` and the experiment's id, both made where they do not exist.

    Arguments:
        prepare: also upgrade the schema of an older sqlite store and set its journal mode.

    Raises:
        InputError: another process holds the store's lock.
        StoreGone: this process has another database open under this name.
    """
    for name, value in _ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    for name in ("urllib3.connectionpool", "alembic"):  # one warning is ours; theirs would come on top, per retry
        logging.getLogger(name).setLevel(logging.ERROR)
    logging.getLogger("mlflow.store.db.utils").setLevel(logging.CRITICAL)  # a traceback for every locked database
    from mlflow.tracking import MlflowClient

    path = database(uri)
    with lock_store(uri):
        check_present(uri)
        new = path is not None and not path.exists()
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
        client = MlflowClient(tracking_uri=uri)
        try:
            existing = client.get_experiment_by_name(experiment)
        except Exception:
            if not (prepare and path is not None and path.exists()):
                raise
            command = [sys.executable, "-m", "mlflow", "db", "upgrade", uri]
            subprocess.run(command, check=True, capture_output=True)
            existing = client.get_experiment_by_name(experiment)
        if path is not None and (new or prepare) and _is_local(path):
            with sqlite3.connect(path) as connection:
                connection.execute("PRAGMA journal_mode=WAL")
            connection.close()
        if existing is None:
            # Only a local store may be told where; a server decides for itself.
            location = None if path is None else str((path.parent / "artifacts").resolve())
            identity = client.create_experiment(experiment, artifact_location=location)
        else:
            identity = existing.experiment_id
        if existing is None or prepare:
            client.set_experiment_tag(
                identity, f"mlflow.sharedViewState.{VIEW}", json.dumps({"selectedColumns": COLUMNS})
            )
        if path is not None:
            _opened.setdefault(path.resolve(), _identity(path))
    return client, identity


def check_present(uri: str) -> None:
    """Look whether a sqlite store's file is still the one that this process opened.

    Raises:
        StoreGone: it is not.
    """
    path = database(uri)
    opened = None if path is None else _opened.get(path.resolve())
    if opened is not None and path is not None and (not path.exists() or _identity(path) != opened):
        raise StoreGone("the database was removed or replaced")


def _identity(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_dev, status.st_ino


def database(uri: str) -> Path | None:
    """The path of a sqlite store's file, None for any other store."""
    return Path(uri.removeprefix("sqlite:///").split("?")[0]) if uri.startswith("sqlite:///") else None


def brief(error: BaseException) -> str:
    """An exception as one short line."""
    text = " ".join(str(error).split())
    reason = re.search(
        "Connection refused|timed out|Name or service not known|No route to host|database is locked", text
    )
    if reason is not None:
        return reason[0].lower()
    return text if isinstance(error, InputError | StoreGone) else f"{type(error).__name__}: {text[:200]}"


def rebuild_command(uri: str, experiment: str, log: Path) -> str:
    """The command that makes the store again from the logs, of which ``log`` is one."""
    path = database(uri)
    results = None if path is None else path.resolve().parent.parent
    if results is not None and path.resolve() == results / "mlflow/mlflow.db" and results in log.resolve().parents:
        command = ["expertaug", "rebuild-tracking", os.path.relpath(results)]
    else:
        command = ["expertaug", "rebuild-tracking", "RESULTS", "--uri", uri]
    return shlex.join(command + ([] if experiment == "expertaug" else ["--experiment", experiment]))


def _is_local(path: Path) -> bool:
    """Whether a file is known to lie on a local disk: write-ahead logging corrupts a database on a network one."""
    try:
        mounts = [line.split()[1:3] for line in Path("/proc/mounts").read_text().splitlines()]
    except OSError:
        return False
    parents = {str(folder) for folder in path.resolve().parents}
    kind = max((m for m in mounts if m[0] in parents), key=lambda mount: len(mount[0]), default=("", "nfs"))[1]
    return _NETWORK_FILE_SYSTEMS.search(kind) is None


@contextmanager
def lock_store(uri: str) -> Iterator[None]:
    """Hold the lock of a store, which keeps two jobs from making the same thing in it twice: a file beside a sqlite
    database, else one in a folder of the user's own.

    Raises:
        InputError: another process held it for two minutes.
    """
    path = database(uri)
    if path is None:
        lock = private_folder() / f"{hashlib.sha256(uri.encode()).hexdigest()[:16]}.lock"
    else:
        lock = path.with_name(f"{path.name}.lock")
    with files.lock_file(lock, LOCK_S):
        yield


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
            status = folder.lstat()
        except OSError:
            continue
        mine = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o022
        if mine and os.access(folder, os.W_OK | os.X_OK):
            return folder
    raise InputError(candidates[0], "cannot be used for locks", "make it a folder that you alone can write to")
