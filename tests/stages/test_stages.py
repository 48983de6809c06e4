"""The stages: what the workflow gives each is what it takes, and a misspelt key is one line before anything runs."""

from __future__ import annotations

import ast
import json
import os
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import get_args, get_origin

import pytest
from pydantic import BaseModel

from expertaug import commands
from expertaug.cli import BAD_INPUT, main
from expertaug.config import load as config
from expertaug.config.load import complete_configuration
from expertaug.config.models import Configuration
from expertaug.evaluation.products import STUDIES
from expertaug.evaluation.studies import KINDS
from expertaug.settings import Settings
from expertaug.stages import STAGES
from expertaug.stages.planned import plan
from expertaug.stages.stage import to_json

ROOT = Path(__file__).parents[2]
FILES = ("config", "smoke", "paper", "code", "ibm", "measurements", "ten_seeds", "field_flows", "data_curves")
# What a rule puts together itself.
OF_RULES = {
    "report": {
        "shown": [],
        "rules": [["train", "evaluate"]],
        "experiments": [],
        "files": ["config/config.yaml"],
        "preset": "paper",
        "seeds": [0],
        "device": "cpu",
    },
}


def table(columns: int) -> str:
    """A file like those that the example on measurements reads."""
    path = Path(tempfile.gettempdir()) / f"expertaug_stages_{os.getpid()}_{columns}.txt"
    rows = [" ".join([str(1 + row // 50), *(str(0.1 * row + k) for k in range(columns - 1))]) for row in range(100)]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return str(path)


@cache
def configured(file: str) -> Configuration:
    files = dict.fromkeys([ROOT / "config" / "config.yaml", ROOT / "config" / f"{file}.yaml"])
    found = config.load(files)
    if file == "ibm":  # a user's own files stand where these are
        found["recordings"]["markers"]["path"] = "."
    if file == "smoke":
        grid = {"method": "aphynity", "keys": {"training.objective.lambda0": [1.0, 2.0]}}
        more = {
            "augmentation": {"prior": None},
            "augmentations": {"narrow": None, "wide": None},
            "studies": {"grid": grid},
            "equation": {},
        }
        found = config.merge(found, {"experiments": {"pendulum": more}})
    if file == "measurements":
        own = {name: found["experiments"][name].get("data", {}) for name in found["run"]}
        for name in [name for name, data in own.items() if "files" in data]:  # others inherit them
            block = found["experiments"][name]["data"]["files"]
            block["paths"], block["horizons_s"] = [table(len(block.get("names", "....")))], [12.0]
    return complete_configuration(found, STAGES)


def jobs_with_settings(configuration: Configuration) -> Iterator[tuple[str, tuple]]:
    """A job of each stage that has settings, experiment and version: the groups of seeds are alike."""
    at_request = [("overlay", (None,)), ("draw_worst_frames", (None,)), ("unpack_markers", ())]
    first: dict[tuple[str, str], tuple[str, tuple]] = {}
    for stage, names in (*plan(configuration), *at_request):
        first.setdefault((stage, str(names[:2])), (stage, names))
    yield from (job for job in first.values() if STAGES[job[0]].slice)


@cache
def examples() -> dict[str, dict]:
    """Settings of the first job of each stage, over all configurations."""
    found = dict(OF_RULES)
    for file in FILES:
        for stage, names in jobs_with_settings(configured(file)):
            found.setdefault(stage, json.loads(STAGES[stage].settings_of(configured(file), *names)))
    return found


def command_line(stage: str, settings: dict, folder: Path) -> list[str]:
    """A call of a stage whose files do not exist."""
    name = STAGES[stage].name
    parser = commands.parser()._subparsers._group_actions[0].choices[name]
    line = [name]
    for action in parser._actions:
        value = "0" if action.type is int else str(folder / "none.npz")
        if action.dest == "settings":
            line += ["--settings", json.dumps(settings)]
        elif not action.option_strings:
            line.append(value)
        elif action.required or (action.dest == "model" and "build" not in settings):
            line += [action.option_strings[0], value]
    return line


def kind_of(stage: str, settings: dict) -> type[Settings]:
    found = []

    class Reading(STAGES[stage]):
        @classmethod
        def read(cls, a):
            return found.append(cls.kind_of(a, settings))

        @staticmethod
        def run(a, job):
            pass

    arguments = commands.parse(command_line(stage, settings, Path("none")))
    Reading.execute(arguments)
    return found[0]


def places(kind: object, settings: object, path: tuple = ()) -> Iterator[tuple]:
    """Paths of keys that a typed block has: names that somebody chose are none."""
    if isinstance(kind, type) and issubclass(kind, BaseModel) and isinstance(settings, dict):
        for name, value in settings.items():
            yield (*path, name)
            yield from places(kind.model_fields[name].annotation, value, (*path, name))
    elif get_origin(kind) is dict and isinstance(settings, dict):
        for name, value in settings.items():
            yield from places(get_args(kind)[1], value, (*path, name))
    elif not isinstance(kind, type):
        for inner in get_args(kind):
            yield from places(inner, settings, path)


def misspelt(settings: dict, path: tuple) -> dict:
    changed = json.loads(json.dumps(settings))
    block = changed
    for part in path[:-1]:
        block = block[part]
    block[path[-1] + "x"] = block.pop(path[-1])
    return changed


@pytest.mark.parametrize("file", FILES)
def test_each_stage_takes_what_the_workflow_gives_it(file):
    given = configured(file)
    for stage, names in jobs_with_settings(given):
        settings = json.loads(STAGES[stage].settings_of(given, *names))
        kind = kind_of(stage, settings)
        assert json.loads(to_json(kind.from_mapping(settings))) == settings, (stage, names)


def test_every_stage_that_has_settings_has_a_job_above():
    assert set(examples()) == {name for name, stage in STAGES.items() if stage.job}


@pytest.mark.parametrize("stage", [name for name, stage in STAGES.items() if stage.job])
def test_a_misspelt_key_is_one_line_before_anything_runs(stage, tmp_path, capsys):
    settings = examples()[stage]
    found = list(places(kind_of(stage, settings), settings))
    assert len(found) >= len(settings)
    for path in found:
        line = command_line(stage, misspelt(settings, path), tmp_path)
        assert main(line) == BAD_INPUT, path
        said = capsys.readouterr().err.strip().splitlines()
        block = ".".join(path[:-1])
        told = (f"{block}{'.' * bool(block)}{path[-1]}x: unknown key", f"{'.'.join(path)}: missing")
        assert any(text in one for text in told for one in said), (path, said)
        assert all(one.startswith(f"expertaug {STAGES[stage].name}: --settings") for one in said)
        assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("stage", "path", "value", "expected"),
    [
        ("train", "seeds", [0, 0], "seeds[1]: 0 is there twice; give each once"),
        ("train", "preset", "papr", "preset: found 'papr'; did you mean 'paper'?"),
        ("train", "system.name", "pendulm", "system.name: found 'pendulm'; did you mean 'pendulum'?"),
        ("train", "system", {"friction": 1.0}, "system.name: missing; known: pendulum"),
        (
            "train",
            "model.encoder",
            {"kind": "recurent"},
            "model.encoder.kind: found 'recurent'; did you mean 'recurrent'?",
        ),
        ("train", "model.interaction", {"kind": 3}, "model.interaction.kind: found 3; known: mlp"),
        ("train", "build.objective", "aphinity", "build.objective: found 'aphinity'; did you mean 'aphynity'?"),
        ("evaluate", "noise", "estimatd", "noise: found 'estimatd'; did you mean 'estimated'?"),
        ("study", "study", "horizon", "study: found 'horizon'; did you mean 'horizons'?"),
        ("report", "preset", "papr", "preset: found 'papr'; did you mean 'paper'?"),
    ],
)
def test_a_misspelt_name_is_one_line_before_anything_runs(stage, path, value, expected, tmp_path, capsys):
    settings = json.loads(json.dumps(examples()[stage]))
    *blocks, name = path.split(".")
    block = settings
    for part in blocks:
        block = block[part]
    block[name] = value
    assert main(command_line(stage, settings, tmp_path)) == BAD_INPUT
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1 and f"--settings.{expected}" in said[0], said
    assert not list(tmp_path.iterdir())


@cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@cache
def lists(path: Path) -> list[tuple[int, set[str]]]:
    """Line of each list, tuple, set or mapping of a module that is written out, and what it lists: texts, or the first
    arguments of calls."""
    every = []
    for node in ast.walk(ast.parse(text_of(path))):
        parts = getattr(node, "elts", None) or getattr(node, "keys", None)
        if not parts:
            continue
        firsts = [part.args[0] if isinstance(part, ast.Call) and part.args else part for part in parts]
        texts = {part.value for part in firsts if isinstance(part, ast.Constant) and isinstance(part.value, str)}
        every += [(node.lineno, texts)] if texts else []
    return every


def listed(path: Path, names: set[str], least: int) -> Iterator[tuple[int, set[str]]]:
    """Line of each list of a module that lists so many of the names, and which."""
    if sum(name in text_of(path) for name in names) >= least:  # most modules need not be parsed
        yield from ((line, texts & names) for line, texts in lists(path) if len(texts & names) >= least)


def test_no_list_of_stages_is_kept_by_hand():
    names = {name for stage, kind in STAGES.items() for name in (stage, kind.name)}
    for path in sorted((ROOT / "src" / "expertaug").rglob("*.py")):
        if path.parent.name == "expertaug":  # what the package offers is named as stages are
            continue
        for line, stages in listed(path, names, 7):
            pytest.fail(f"{path}:{line} lists stages: {sorted(stages)}")


def test_studies_are_listed_once():
    """Their names, where a stage makes several: all else follows."""
    names = {kind.name for kind in STUDIES}
    modules = [path for package in ("src", "workflow") for path in (ROOT / package).rglob("*.py")]
    places = {path.name for path in modules for _ in listed(path, names, 2)}
    assert places == {"products.py"}
    assert set(KINDS) == names
