"""Notebooks pass as written: every cell of code, in order, without a kernel."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

import warm_python

NOTEBOOKS = sorted((Path(__file__).parents[1] / "docs" / "notebooks").glob("*.ipynb"))


WORKFLOW = '["expertaug", "run", '  # in a cell: minutes


def cells_of(path: Path) -> list[dict]:
    return json.loads(path.read_text(encoding="utf-8"))["cells"]


def code_of(path: Path) -> list[str]:
    return ["".join(cell["source"]) for cell in cells_of(path) if cell["cell_type"] == "code"]


def run(code: list[str], folder: Path) -> str:
    """What cells say to stderr."""
    script = folder / "cells.py"
    plain = [line for line in "\n\n".join(code).splitlines() if not line.startswith("%")]  # of a notebook alone
    script.write_text("import matplotlib\n\nmatplotlib.use('agg')\n" + "\n".join(plain) + "\n", encoding="utf-8")
    command, env = [warm_python.interpreter(), script], os.environ | {"PATH": warm_python.path()}
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_cell_runs(path, tmp_path):
    """Of the workflow only what it would do is asked here; the test below lets it."""
    code = [cell.split("\nprint(Path(")[0] if WORKFLOW in cell else cell for cell in code_of(path)]
    said = run([cell.replace(WORKFLOW, WORKFLOW + '"--dry-run", ') for cell in code], tmp_path)
    text = " ".join(" ".join("".join(cell["source"]) for cell in cells_of(path)).split())
    assert ("trusted is False" in said) == ("line of warning" in text), "the text tells of the warning, and it comes"


@pytest.mark.slow
@pytest.mark.parametrize("path", [p for p in NOTEBOOKS if WORKFLOW in "".join(code_of(p))], ids=lambda p: p.stem)
def test_its_workflow_runs(path, tmp_path):
    run(code_of(path), tmp_path)
    assert "Alternating" in (tmp_path / "results" / "cart" / "tables" / "cart.md").read_text()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_is_stored_with_what_it_printed(path):
    outputs = [output for cell in cells_of(path) for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not any(output["output_type"] == "error" for output in outputs)
    assert path.stat().st_size < 400_000
