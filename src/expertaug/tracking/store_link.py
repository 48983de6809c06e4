"""A run log's connection to its tracking store, which may break and come back while the job goes on."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from expertaug.tracking.log_file import read_log
from expertaug.tracking.mlflow_mirror import Mirror
from expertaug.tracking.mlflow_store import StoreGone, brief, rebuild_command

logger = logging.getLogger(__name__)

FIRST_WAIT_S, LONGEST_WAIT_S = 30.0, 600.0


class StoreLink:
    """Keeps a store up to date with a run log; a failure costs a warning and some waiting, never the job.

    What a broken connection missed is read back from the log, which is the truth, when the store answers again.

    Arguments:
        tracking: ``{"uri", "experiment"}``.
        path, header: the run log and its first line.
        runs, parent: run ids by seed and that of the parent, as an earlier process stored them.
        replaced: the id of the log that was at this path before.

    Attributes:
        runs, parent: as given, or as the store has them.
    """

    def __init__(
        self,
        tracking: Mapping[str, Any],
        path: Path,
        header: Mapping[str, Any],
        runs: Mapping[str, str],
        parent: str | None,
        replaced: str | None,
    ) -> None:
        self.runs, self.parent = dict(runs), parent
        self._uri, self._experiment = tracking["uri"], tracking["experiment"]
        self._path, self._header, self._replaced = path, header, replaced
        self._mirror: Mirror | None = None
        self._next, self._wait = 0.0, FIRST_WAIT_S  # when a broken connection is tried again
        self._told = False

    def send(self, lines: Sequence[Mapping[str, Any]], now: bool = False) -> None:
        """Store new lines of the log, which are in its file already.

        Arguments:
            now: try again also where the store failed a moment ago.
        """
        again = now and self._mirror is not None  # its first failure is no reason yet to give up
        self._try(lines, now)
        if again and self._mirror is None:
            self._try((), now)

    @property
    def works(self) -> bool:
        """Whether the store has all that was sent."""
        return self._mirror is not None

    def end(self) -> None:
        """Say how to mend a store that lacks lines of the log, which is complete."""
        if not self.works:
            command = rebuild_command(self._uri, self._experiment, self._path)
            logger.warning("tracking store %s lacks part of %s; once it works: %s", self._uri, self._path, command)

    def _try(self, lines: Sequence[Mapping[str, Any]], now: bool) -> None:
        if self._mirror is None and not now and time.monotonic() < self._next:
            return
        try:
            if self._mirror is None:
                mirror = Mirror(self._uri, self._experiment, self._header, self._path, self.runs, self._replaced)
                lines = read_log(self._path).lines
                self.runs, self.parent, self._mirror = dict(mirror.runs), mirror.parent, mirror
                if self._told:
                    logger.info("tracking store %s answers again", self._uri)
            if lines:
                self._mirror.write(lines)
            self._wait = FIRST_WAIT_S
        except Exception as error:
            self._failed(error)

    def _failed(self, error: Exception) -> None:
        self._mirror = None
        # A database that is gone cannot come back: MLflow keeps the old one open as long as the process lives.
        self._next = float("inf") if isinstance(error, StoreGone) else time.monotonic() + self._wait
        self._wait = min(2 * self._wait, LONGEST_WAIT_S)
        if not self._told:
            self._told = True
            text = "tracking store %s failed (%s); the run goes on and is logged in %s"
            logger.warning(text, self._uri, brief(error), self._path)


def store(path: Path, tracking: Mapping[str, Any]) -> dict[str, str] | None:
    """Store a log that was written without a store.

    Arguments:
        path: the run log.
        tracking: ``{"uri", "experiment"}``.

    Returns:
        The ids of its runs by seed, and of the ``parent``; None, with a warning, where the store failed twice.
    """
    header = read_log(path).header
    link = StoreLink(tracking, path, header, header.get("runs") or {}, header.get("parent"), None)
    link.send((), now=True)
    if not link.works:
        link.send((), now=True)
    link.end()
    return {**link.runs, "parent": link.parent or ""} if link.works else None
