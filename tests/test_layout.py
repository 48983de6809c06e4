"""The house: every module in its place, imports one way and without a circle, also of those named by strings."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[1] / "src"
PACKAGES = ("expertaug", "expertaug_recordings")
# From the ground up: a module may import from its own floor and from those below; the package beside has one floor.
FLOORS = (
    (
        "errors",
        "files",
        "wording",
        "settings",
        "trajectories",
        "windows",
        "versions",
        "hues",
        "plotting",
        "presets",
        "registry",
        "rows",
        "source_files",
    ),
    ("measurements",),
    ("systems",),
    ("models",),
    ("tracking",),
    ("learning",),
    ("inference",),
    ("equation",),
    ("evaluation",),
    ("expertaug_recordings",),
    ("config",),
    ("runs",),
    ("api",),
    ("stages",),
    ("commands",),
    ("cli", "__init__"),
)
LONGEST = 600  # lines of a module: beyond it, look whether it is one concept
NAMED = re.compile(r"expertaug(?:_recordings)?(?:\.\w+)+(?::\w+)?")


@cache
def modules() -> dict[str, Path]:
    """Path of each module of both packages by its dotted name."""
    found = {}
    for path in sorted(path for package in PACKAGES for path in (SOURCES / package).rglob("*.py")):
        parts = path.relative_to(SOURCES).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def imported(name: str) -> frozenset[str]:
    """Modules of the packages that a module imports, also inside functions, or names in a text (docstrings aside)."""
    known, path = modules(), modules()[name]
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    texts = {id(n.value) for n in nodes if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)}
    found: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: relative imports hide where a name comes from"
            found |= {node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in texts:
            found |= {text.partition(":")[0] for text in NAMED.findall(node.value)}
    return frozenset(found & set(known)) - {name, "expertaug"}


def floor(name: str) -> int:
    package, _, inside = name.partition(".")
    room = (inside or "__init__").partition(".")[0] if package == PACKAGES[0] else package
    return next((k for k, rooms in enumerate(FLOORS) if room in rooms), -1)


@pytest.mark.parametrize("name", modules())
def test_each_module_has_a_floor_and_imports_nothing_from_above(name):
    assert floor(name) >= 0, "no module lies loose beyond those that FLOORS lists"
    above = {other for other in imported(name) if floor(other) > floor(name)}
    assert not above, f"{name} imports from above: {sorted(above)}"


def test_no_circle():
    done: set[str] = set()

    def visit(name: str, after: tuple[str, ...]) -> None:
        assert name not in after, " → ".join((*after[after.index(name) :], name))
        if name not in done:
            for other in imported(name):
                visit(other, (*after, name))
            done.add(name)

    for name in modules():
        visit(name, ())


@pytest.mark.parametrize("path", modules().values(), ids=lambda path: str(path.relative_to(SOURCES)))
def test_each_module_is_one_concept_and_says_what_it_is(path):
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) < LONGEST, "one concept a module"
    assert not text.strip() or ast.get_docstring(ast.parse(text)), "a module begins with what it is"
    assert not text.startswith('"""\n'), "in its first line"


def test_every_folder_is_a_subject_with_a_line_of_its_own():
    for folder in {path.parent for path in modules().values()} - {SOURCES / PACKAGES[0]}:
        text = (folder / "__init__.py").read_text(encoding="utf-8")
        assert ast.get_docstring(ast.parse(text)), f"{folder.name}/__init__.py says what the folder holds"


def test_folders_of_tests_are_those_of_the_modules():
    tests = Path(__file__).parent
    folders = {path.parent.relative_to(tests) for path in tests.rglob("test_*.py")} - {Path()}
    beside = {Path("driven"), Path("workflow")}  # what known inputs touch; Snakemake's files
    for folder in folders - beside:
        room, *rest = folder.parts
        place = Path(PACKAGES[1], *rest) if room == "recordings" else Path(PACKAGES[0], folder)
        assert (SOURCES / place / "__init__.py").exists(), f"tests/{folder} has no {place} to test"


TESTED = [name for name, path in modules().items() if path.name not in ("__init__.py", "_version.py")]


@pytest.mark.parametrize("name", TESTED)
def test_every_module_has_a_file_of_tests_at_its_place_that_imports_it(name):
    package, *rooms, own = name.split(".")
    folder = Path(__file__).parent.joinpath(*(["recordings"] if package == PACKAGES[1] else []), *rooms)
    path = folder / f"test_{own}.py"
    assert path.is_file(), f"the tests of {name} stand in {path.relative_to(folder.parents[len(rooms)])}"
    within = [n for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.ImportFrom)]
    taken = {node.module for node in within} | {f"{n.module}.{alias.name}" for n in within for alias in n.names}
    assert name in taken, f"{path.name} imports nothing of {name}"


def test_what_selects_passes_has_a_name_of_its_own():
    told = [*modules().values(), SOURCES.parent / "config" / "README.md", *(SOURCES.parent / "docs").glob("*.md")]
    assert not [str(path) for path in told if "validation log-MSE" in path.read_text(encoding="utf-8")]
