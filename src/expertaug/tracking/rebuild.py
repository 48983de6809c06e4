"""Making the tracking store again from the run logs."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path

from expertaug import files
from expertaug.errors import InputError
from expertaug.tracking import store
from expertaug.tracking.log import Log, read_log
from expertaug.tracking.metrics_csv import log_of_table
from expertaug.tracking.settings import MARKER, Tracking, tracking_of_run
from expertaug.tracking.sync import Mirror


def rebuild(results: Path, uri: str, experiment: str) -> int:
    """Make the tracking store again from every run log below ``results``, and from each metrics.csv that has none.

    A sqlite store that exists is moved, with its artifacts, into the folder ``previous`` beside it (which replaces what
    an earlier rebuild left there); on a server only what it lacks is added. Runs get new ids.

    Returns:
        The number of logs and tables that were stored.

    Raises:
        InputError: there is nothing to store, a log cannot be read or the store cannot be used; the old store is then
            in its place.
    """
    database = store.database(uri)
    if database is not None and database.absolute().is_relative_to(Path(results).absolute()):
        files.check_inside(database.parent, results)
    logs = list(_find_logs(Path(results), database)) if Path(results).is_dir() else []
    if not logs:
        raise InputError(results, "no run log and no metrics.csv below it", "give the results folder of a run")
    marked = tracking_of_run(results)
    before = marked if marked is not None and marked.uri == uri and marked.experiment == experiment else None
    tracking = Tracking(enabled=True, uri=uri, experiment=experiment)
    moved = _move_aside(database) if database is not None else []
    try:
        numbers = before.experiments or {} if before is not None else {}
        # In the order of their making, so that they get the numbers that they had.
        names = sorted(
            {log.header.experiment for _, log in logs} | set(numbers), key=lambda name: _number(numbers, name)
        )
        made = {name: store.connect(uri, tracking.name_of(name), prepare=True)[1] for name in names}
        for path, log in sorted(logs, key=lambda entry: entry[1].header.time):
            Mirror(tracking, log.header, path).write(log.lines)
    except Exception as error:
        if moved:
            _move_back(database, moved)
        if isinstance(error, InputError):
            raise
        problem = f"the tracking store cannot be made ({store.brief(error)})"
        raise InputError(uri, problem, "check tracking.uri") from error
    if before is not None:
        marker = before.model_copy(update={"experiments": made})
        files.write_json(Path(results) / MARKER, marker.model_dump(exclude={"rule"}))
    return len(logs)


def _number(numbers: Mapping[str, str], name: str) -> tuple[bool, int, str]:
    """Sorts experiments by the number that a store has given them, others behind them."""
    number = numbers.get(name, "")
    return not number.isdecimal(), int(number) if number.isdecimal() else 0, name


def _find_logs(results: Path, database: Path | None) -> Iterator[tuple[Path, Log]]:
    """Every log with its path; a table that has none, with the one that the evaluation would have written."""
    evaluated = set()
    for path in _find(results, "*.jsonl", database):
        log = read_log(path)
        if log.header.stage == "evaluate":
            evaluated.add(path.parent)
        yield path, log
    for path in _find(results, "metrics.csv", database):
        if path.parent not in evaluated:
            yield path.with_name("evaluation.jsonl"), log_of_table(path)


def _find(results: Path, pattern: str, database: Path | None) -> list[Path]:
    """Files below ``results`` but for work in progress (hidden folders), published copies and the store's own."""
    own = set() if database is None else {database.parent.resolve() / name for name in ("artifacts", "previous")}
    paths = []
    for path in files.find(results, pattern):
        parts = path.relative_to(results).parts
        hidden = parts[0] == "published" or any(part.startswith(".") for part in parts)
        if not hidden and own.isdisjoint(path.resolve().parents):
            paths.append(path)
    return paths


def _parts(database: Path) -> list[Path]:
    """Everything that makes up a store; a write-ahead log must never meet another database than its own."""
    names = [f"{database.name}{end}" for end in ("", "-wal", "-shm")]
    return [path for path in (database.with_name(name) for name in (*names, "artifacts")) if os.path.lexists(path)]


def _move_aside(database: Path) -> list[Path]:
    moved = _parts(database)
    previous = database.parent / "previous"
    if moved:
        _remove(previous)
        previous.mkdir()
        for path in moved:
            path.replace(previous / path.name)
    return moved


def _move_back(database: Path, moved: list[Path]) -> None:
    for path in _parts(database):
        _remove(path)
    for path in moved:
        (database.parent / "previous" / path.name).replace(path)


def _remove(path: Path) -> None:
    """Remove a file, a folder or a link; never what a link leads to."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
