"""The MLflow store: made once, shared by all processes.

mlflow takes more than a second to import, so it is imported only inside the functions that need it.
"""

from __future__ import annotations

import fcntl
import hashlib
import logging
import os
import re
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from expertaug import files

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


def initialise(uri: str, experiment: str, marker: Path) -> None:
    """Create or upgrade the store and the experiment, once, before any process logs to it.

    A store that cannot be used is a warning: trainings then write their JSON lines only.

    Arguments:
        uri: of the tracking store: ``sqlite:///results/mlflow/mlflow.db`` or ``http://…``.
        experiment: name of the MLflow experiment. A local store's artifacts lie in ``artifacts`` beside the database.
        marker: JSON file written at the end, the stage's output.

    Raises:
        InputError: the marker cannot be written.
    """
    found = None
    try:
        found = connect(uri, experiment, prepare=True)[1]
    except Exception as error:
        logger.warning(
            "tracking store %s cannot be used (%s); runs are logged to their JSON lines only", uri, brief(error)
        )
    files.write_json(marker, {"uri": uri, "experiment": experiment, "experiment_id": found})


def connect(uri: str, experiment: str, prepare: bool = False) -> tuple[Any, str]:
    """An ``MlflowClient`` and the experiment's id, both made where they do not exist.

    Arguments:
        prepare: also upgrade the schema of an older sqlite store and set its journal mode.
    """
    for name, value in _ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    for name in ("urllib3.connectionpool", "alembic"):  # one warning is ours; theirs would come on top, per retry
        logging.getLogger(name).setLevel(logging.ERROR)
    from mlflow.tracking import MlflowClient

    path = database(uri)
    with locked(uri):
        new = path is not None and not path.exists()
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
        client = MlflowClient(tracking_uri=uri)
        try:
            found = client.get_experiment_by_name(experiment)
        except Exception:
            if not (prepare and path is not None and path.exists()):
                raise
            command = [sys.executable, "-m", "mlflow", "db", "upgrade", uri]
            subprocess.run(command, check=True, capture_output=True)
            found = client.get_experiment_by_name(experiment)
        if path is not None and (new or prepare) and _is_local(path):
            with sqlite3.connect(path) as connection:
                connection.execute("PRAGMA journal_mode=WAL")
            connection.close()
        if found is None:
            # Only a local store may be told where; a server decides for itself.
            location = None if path is None else str((path.parent / "artifacts").resolve())
            return client, client.create_experiment(experiment, artifact_location=location)
    return client, found.experiment_id


def database(uri: str) -> Path | None:
    """The file of a sqlite store, None for any other."""
    return Path(uri.removeprefix("sqlite:///").split("?")[0]) if uri.startswith("sqlite:///") else None


@contextmanager
def locked(uri: str) -> Iterator[None]:
    """Hold the lock of a store: a file beside a sqlite database, else one in the folder for temporary files."""
    path = database(uri)
    if path is None:
        name = hashlib.sha256(uri.encode()).hexdigest()[:16]
        lock = Path(tempfile.gettempdir()) / f"expertaug-{os.getuid()}-{name}.lock"
    else:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = path.with_name(f"{path.name}.lock")
    with lock.open("a") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        yield


def brief(error: BaseException) -> str:
    """An exception as one short line."""
    text = " ".join(str(error).split())
    refused = re.search(r"Connection refused|timed out|Name or service not known|No route to host", text)
    return refused[0].lower() if refused else f"{type(error).__name__}: {text[:200]}"


def _is_local(path: Path) -> bool:
    """Whether a file is known to lie on a local disk: write-ahead logging corrupts a database on a network one."""
    try:
        mounts = [line.split()[1:3] for line in Path("/proc/mounts").read_text().splitlines()]
    except OSError:
        return False
    parents = {str(folder) for folder in path.resolve().parents}
    kind = max((m for m in mounts if m[0] in parents), key=lambda mount: len(mount[0]), default=("", "nfs"))[1]
    return _NETWORK_FILE_SYSTEMS.search(kind) is None
