"""The files that a stage is made of: nothing that it imports is missing."""

from __future__ import annotations

import ast
import importlib
import json
import subprocess
from pathlib import Path

import pytest

import warm_python
from expertaug import source_files
from expertaug.errors import InputError
from expertaug.stages import STAGES

MODULES = sorted({stage.code for stage in STAGES.values()})
# Each module is imported by a fork of a process that has imported nothing of ours but what the module's stage declares:
# what several have in common once for all of them.
IMPORTS = """
import collections, importlib, json, os, sys
def load(declared):
    while declared:
        one, *more = declared
        counts = collections.Counter(name for names in declared.values() for name in names if name not in sys.modules)
        most, count = max(counts.items(), key=lambda found: found[1], default=(None, 0))
        if not more:
            importlib.import_module(one)
            files = [m.__file__ for name, m in sys.modules.items() if name.startswith("expertaug")]
            print(json.dumps([one, files]), flush=True)
            return
        if count == len(declared):
            importlib.import_module(most)
            continue
        chosen = [module for module in declared if most in declared[module]] if count > 1 else [one]
        forked = {module: declared[module] for module in chosen}
        if not os.fork():
            load(forked)
            os._exit(0)
        assert os.wait()[1] == 0, list(forked)
        declared = {module: names for module, names in declared.items() if module not in forked}
assert not [name for name in sys.modules if name.startswith("expertaug")]
load(json.loads(sys.argv[1]))
"""


def names_of(stage):
    """The modules of a stage's files."""
    paths = (path.relative_to(source_files.PACKAGE.parent).with_suffix("") for path in stage.sources())
    return sorted(".".join(path.parts).removesuffix(".__init__") for path in paths)


@pytest.fixture(scope="module")
def loaded_by():
    """Files of this package that importing a module loads."""
    declared = {stage.code: names_of(stage) for stage in reversed(STAGES.values())}
    command = [warm_python.interpreter(), "-c", IMPORTS, json.dumps(declared)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return dict(map(json.loads, done.stdout.splitlines()))


@pytest.mark.parametrize("module", MODULES)
def test_declared_files_are_those_that_importing_the_stage_loads(module, loaded_by):
    stage = next(stage for stage in STAGES.values() if stage.code == module)
    loaded = {Path(file).resolve() for file in loaded_by[module]}
    without = {
        source_files.PACKAGE.parent.joinpath(*m.split(".")).with_suffix(".py") for m in source_files.WITHOUT_EFFECT
    }
    declared = {path.resolve() for path in stage.sources()}
    assert loaded - without <= declared
    assert all(path.is_file() for path in declared)


def test_a_named_class_brings_its_file(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text("class System: pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    found = STAGES["train"].sources(["mine:System", "expertaug.systems.pendulum"])
    assert any(path.name == "mine.py" for path in found)
    assert any(path.name == "pendulum.py" for path in found)
    assert not any(path.name in ("double_pendulum.py", "cli.py") for path in found)


def test_what_a_named_module_imports_is_followed(tmp_path, monkeypatch):
    folder = tmp_path / "outside"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "constants.py").write_text("G = 9.81\n")
    (folder / "unused.py").touch()
    text = "import torch\nfrom . import constants\nfrom expertaug.learning.hvae import HybridVAE\n"
    (folder / "mine.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    new = set(STAGES["simulate"].sources(["outside.mine:Mine"])) - set(STAGES["simulate"].sources())
    names = {path.name for path in new}
    assert {"mine.py", "constants.py", "hvae.py"} <= names
    assert "unused.py" not in names and not any("site-packages" in path.parts for path in new)


def imports_of(tree, module, is_package):
    """Modules that the import statements of a syntax tree name."""
    package = module.split(".") if is_package else module.split(".")[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else []
            source = ".".join([*above, *([node.module] if node.module else [])])
            yield from [source, *(f"{source}.{alias.name}" for alias in node.names)]


@pytest.mark.parametrize("package", [*source_files.PACKAGES, "_pytest", "email", "json", "yaml"])
def test_imports_are_those_of_the_syntax_tree(package):
    folder = Path(importlib.import_module(package).__file__).parent
    assert len(list(folder.rglob("*.py"))) > 3
    for path in folder.rglob("*.py"):
        module = ".".join([package, *path.relative_to(folder).with_suffix("").parts])
        tree = ast.parse(path.read_text(encoding="utf-8"))
        found = source_files._list_imports(path, module)
        assert sorted(found) == sorted(imports_of(tree, module, path.name == "__init__.py")), path


IMPORTING = r"""
import a, b.c as d  # import no
if x: from e import (f,  # import no
    g as h)
'''
import no
'''; from . import i; import \
    j
def k():
	from..l import m
    return "import no" 'import no \' import no' f'''
from no import no''' # '
value = (yield
    from n)
from o import *
"""


def test_imports_are_found_wherever_they_stand(tmp_path):
    path = tmp_path / "module.py"
    path.write_text(IMPORTING)
    found = source_files._list_imports(path, "expertaug.room.module")
    expected = "a b.c e e.f e.g expertaug.room expertaug.room.i j expertaug.l expertaug.l.m o o.*"
    assert list(found) == expected.split()


def test_a_strangers_file_may_begin_with_a_byte_order_mark(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text("\ufeffimport a\n", encoding="utf-8")
    assert source_files._list_imports(path, "mine") == ("a",)


def test_modules_that_do_not_exist_are_named():
    with pytest.raises(InputError, match=r"system\.name: no module 'no\.such'"):
        source_files.find("system.name", "no.such:Class")
    with pytest.raises(InputError, match=r"expertaug\.systems\.none: no such module"):
        STAGES["train"].sources(["expertaug.systems.none"])
