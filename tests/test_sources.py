"""The files that a stage is made of: nothing that it imports is missing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from expertaug import source_files
from expertaug.config import stage_code
from expertaug.errors import InputError


@pytest.mark.parametrize("module", sorted(set(stage_code.STAGES.values())))
def test_declared_files_are_those_that_importing_the_stage_loads(module):
    stage = next(stage for stage, name in stage_code.STAGES.items() if name == module)
    code = f"import sys, {module}; print(*[m.__file__ for n, m in sys.modules.items() if n.startswith('expertaug')])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {Path(line).resolve() for line in done.stdout.split()}
    without = {source_files.PACKAGE.joinpath(*m.split(".")).with_suffix(".py") for m in source_files.WITHOUT_EFFECT}
    declared = {Path(path).resolve() for path in stage_code.sources(stage)}
    assert loaded - without <= declared
    assert all(path.is_file() for path in declared)


def test_a_named_class_brings_its_file(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text("class System: pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    found = stage_code.sources("train", ["mine:System", "expertaug.systems.pendulum"])
    assert any(path.endswith("mine.py") for path in found)
    assert any(path.endswith("pendulum.py") for path in found)
    assert not any(path.endswith(("double_pendulum.py", "cli.py")) for path in found)


def test_what_a_named_module_imports_is_followed(tmp_path, monkeypatch):
    folder = tmp_path / "outside"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "constants.py").write_text("G = 9.81\n")
    (folder / "unused.py").touch()
    text = "import torch\nfrom . import constants\nfrom expertaug.learning.hvae import HybridVAE\n"
    (folder / "mine.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    new = set(stage_code.sources("simulate", ["outside.mine:Mine"])) - set(stage_code.sources("simulate"))
    names = {Path(path).name for path in new}
    assert {"mine.py", "constants.py", "hvae.py"} <= names
    assert "unused.py" not in names and not any("site-packages" in path for path in new)


def test_modules_that_do_not_exist_are_named():
    with pytest.raises(InputError, match=r"system\.name: no module 'no\.such'"):
        source_files.find("system.name", "no.such:Class")
    with pytest.raises(InputError, match=r"expertaug\.systems\.none: no such module"):
        stage_code.sources("train", ["expertaug.systems.none"])
