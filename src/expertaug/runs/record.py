"""Whose results a folder holds: a run of other configuration files does not overwrite finished tables unasked.

The folder remembers the files that a run was configured by, not what they said: changing a file and running again is
the ordinary way to work, running another file into the same folder is most often a forgotten ``results``.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from pathlib import Path

from expertaug.config.models import Configuration
from expertaug.errors import InputError
from expertaug.files import read_json, write_json
from expertaug.tracking.provenance import revision

NAME = ".configuration.json"
# Keys that change no table of an experiment.
HARMLESS = ("run", "device", "tracking", "overwrite", "results")


def refuse_another(config: Configuration, files: Iterable[str | Path]) -> None:
    """Refuse a completed configuration whose results folder holds finished tables of other files.

    Arguments:
        files: those that override the default configuration, in order.

    Raises:
        InputError: the folder's record names other files, the configuration differs, and ``overwrite`` is not set.
    """
    folder = Path(config.results)
    runs = _runs(folder)
    finished = any((folder / "tables").glob("*_long.csv")) if (folder / "tables").is_dir() else False
    if not runs or not finished or config.overwrite:
        return
    names = _names(files)
    if all(run["files"] != names and run["digest"] != _digest(config) for run in runs):
        problem = f"'{folder}' holds the tables of {_say(runs[-1]['files'])}, not of {_say(names)}"
        raise InputError(
            "results", problem, "give another folder (results: …), or set overwrite: true to take this one"
        )


def remember(config: Configuration, files: Iterable[str | Path]) -> None:
    """Write into the results folder by which files it is configured, and at which revision of the code it is run."""
    folder, names, recorded = Path(config.results), _names(files), _runs(Path(config.results))
    before = next((entry["revisions"] for entry in recorded if entry["files"] == names), [])
    revisions = [*before, *({revision() or "unknown"} - set(before))]
    run = {"files": names, "digest": _digest(config), "revisions": revisions}
    runs = [*(entry for entry in recorded if entry["files"] != names), run]
    if runs != recorded:
        write_json(folder / NAME, {"runs": runs})


def revisions(results: Path) -> list[str]:
    """The revisions of the code at which runs filled a results folder, sorted."""
    return sorted({revision for run in _runs(results) for revision in run["revisions"]})


def _runs(folder: Path) -> list[dict]:
    if not (folder / NAME).is_file():
        return []
    content = read_json(folder / NAME)
    runs = content.get("runs", []) if isinstance(content, dict) else []
    entries = [run for run in runs if isinstance(run, dict)] if isinstance(runs, list) else []
    return [
        {"files": run.get("files"), "digest": run.get("digest"), "revisions": _texts(run.get("revisions"))}
        for run in entries
    ]


def _texts(stored: object) -> list[str]:
    return [text for text in stored if isinstance(text, str)] if isinstance(stored, list) else []


def _names(files: Iterable[str | Path]) -> list[str]:
    return [os.path.relpath(file) for file in files]


def _say(names: object) -> str:
    return " and ".join(names) if isinstance(names, list) and names else "the default configuration"


def _digest(config: Configuration) -> str:
    return hashlib.sha256(json.dumps(config.dump(exclude=HARMLESS), sort_keys=True).encode()).hexdigest()
