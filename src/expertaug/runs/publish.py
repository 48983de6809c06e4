"""Copies the tables and figures of a full run, with their provenance, to a folder that is kept."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TypeAlias

import yaml
from PIL import Image

from expertaug.config.models import Configuration
from expertaug.errors import InputError
from expertaug.evaluation import costs, run_record
from expertaug.files import check_inside, read_json, write_json, write_text
from expertaug.runs.record import revisions

REPOSITORY = Path(__file__).parents[3]
RECORD = "provenance.json"
Kept: TypeAlias = Callable[[list[str]], list[str]]
OWN = (RECORD, "config.yaml", "costs.csv")  # beside what is copied
OF_DATA = ("data/splits.json", "data/calibration.json")  # of an experiment
RECORDINGS = ("recordings/summary.csv", "recordings/summary.md")


def publish(config: Configuration, folder: Path, command: str, kept: Kept) -> None:
    """Replace ``folder`` by the tables and figures of the finished run of a configuration.

    Besides them it holds config.yaml (the completed configuration), costs.csv (seconds and peak memory of every job of
    these experiments and their recordings) and provenance.json (command, git revisions of the code that trained and
    of the code that was run, package versions, machine, jobs' seconds in sum, peak memory, files).

    Arguments:
        config: the completed configuration of the run.
        folder: the target, which does not exist, is empty or was published before.
        command: how the run was started, for the record.
        kept: names the tables and pictures of experiments, in the results folder.

    Raises:
        InputError: a figure or table of the run is missing, or the folder holds anything that was not published.
    """
    results = Path(config.results)
    folder = Path(os.path.realpath(folder))  # a link stays, and what it leads to is replaced
    for experiment in config.run:
        for needed in (results / f"tables/{experiment}.md", results / f"figures/{experiment}_log_mse.png"):
            if not needed.exists():
                raise InputError(needed, "no such file", "run the workflow to its end first")
    _check_replaceable(folder, results, kept)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent, ignore_cleanup_errors=True) as name:
        new, old = Path(name) / "new", Path(name) / "old"
        _fill(new, results, config, command, kept)
        if folder.exists():
            folder.rename(old)
        try:
            new.rename(folder)
        except BaseException:
            if old.exists():
                old.rename(folder)
            raise


def _check_replaceable(folder: Path, results: Path, kept: Kept) -> None:
    """Look whether replacing a folder destroys nothing but what an earlier publishing made.

    Raises:
        InputError: it is, holds or lies in something else.
    """
    remedy = "choose a folder that does not exist yet, or one that publish made"
    for vital, name in ((Path.cwd(), "working directory"), (results, "results folder"), (REPOSITORY, "package")):
        if Path(os.path.realpath(vital)).is_relative_to(folder):
            raise InputError(folder, f"is or contains the {name}", remedy)
    if ".git" in folder.parts:
        raise InputError(folder, "lies in a repository's .git", remedy)
    if not folder.exists():
        return
    if not folder.is_dir():
        raise InputError(folder, "is no folder", remedy)
    record = read_json(folder / RECORD) if (folder / RECORD).is_file() else None
    if not isinstance(record, dict) or not record.keys() >= {"command", "git_revisions"}:
        if any(folder.iterdir()):
            raise InputError(folder, f"has no {RECORD} of a published run, so it is somebody's own", remedy)
        return
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_symlink() or not path.is_dir()}
    if any(".git" in Path(path).parts for path in files):
        raise InputError(folder, "is or contains a repository", remedy)
    ours = record["files"] if isinstance(record.get("files"), list) else _list_published(folder, kept)
    strangers = sorted(files - set(ours))
    if strangers:
        raise InputError(folder / strangers[0], "publish did not write this file and would delete it", "move it")


def _list_published(folder: Path, kept: Kept) -> list[str]:
    """What publishing may have made of a folder whose record, as those of before, does not list it: what would be kept
    of the experiments that its config.yaml names."""
    try:
        config = yaml.safe_load((folder / "config.yaml").read_text(encoding="utf-8"))
        return [*OWN, *_files(list(map(str, config["run"])), kept)]
    except (OSError, ValueError, KeyError, TypeError, yaml.YAMLError):
        return list(OWN)


def _files(experiments: list[str], kept: Kept) -> list[str]:
    """What is copied of a run, as far as it is there, in the results folder."""
    of_data = [f"{experiment}/{file}" for experiment in experiments for file in OF_DATA]
    return [*kept(experiments), *of_data, *RECORDINGS]


def _fill(new: Path, results: Path, config: Configuration, command: str, kept: Kept) -> None:
    """Copy the kept files of a run to a new folder and write its record."""
    filmed = bool(config.on_recordings)
    for file in _files(config.run, kept):
        if (results / file).exists() and (filmed or file not in RECORDINGS):
            (new / file).parent.mkdir(parents=True, exist_ok=True)
            copy(check_inside(results / file, results), new / file)
    own = {*config.run, *([None] if filmed else [])}
    every = costs.of_run(results / "logs")
    measured = {job: cost for job, cost in every.items() if _experiment(job, config.experiments) in own}
    write_text(new / "costs.csv", costs.as_csv(measured))
    anywhere = config.model_copy(update={"tracking": config.tracking.model_copy(update={"uri": None})})
    write_text(new / "config.yaml", yaml.safe_dump(anywhere.dump(), sort_keys=False, allow_unicode=True))
    record = {
        "command": command,
        **asdict(run_record.of_run(results, measured)),
        "run_revisions": revisions(results),
        "files": sorted([RECORD, *(str(path.relative_to(new)) for path in new.rglob("*") if path.is_file())]),
    }
    write_json(new / RECORD, record)


def copy(source: Path, target: Path) -> None:
    """Copy a file; a picture with 256 colours, which a figure of lines does with, in a third of the bytes."""
    try:
        with Image.open(source, formats=["PNG"]) as picture:
            flat = Image.new("RGB", picture.size, "white")
            flat.paste(picture, mask=picture.getchannel("A") if picture.mode == "RGBA" else None)
    except (OSError, Image.DecompressionBombError):  # no picture, a broken or an absurd one: as it is
        shutil.copyfile(source, target)
    else:
        flat.quantize(256, dither=Image.Dither.NONE).save(target, "PNG", optimize=True)


def _experiment(job: str, experiments: Iterable[str]) -> str | None:
    """The experiment that a job is of; None of one of a recording, or of several."""
    name = f"{job.partition('/')[2]}_"
    return max((experiment for experiment in experiments if name.startswith(f"{experiment}_")), key=len, default=None)
