"""Which files of this package a stage is made of, so that the workflow redoes it when one of them changes.

Files are found by following the import statements, without importing anything: the workflow asks for every rule
whenever it starts.
"""

from __future__ import annotations

import ast
import importlib.util
import os
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from expertaug.errors import InputError

PACKAGE = Path(__file__).resolve().parents[1]

# Stage → the module whose public function does its work.
STAGES = {
    "init_tracking": "expertaug.tracking.mlflow_store",
    "render_video": "expertaug.recordings.rendering.render",
    "extract_frames": "expertaug.recordings.video.frame_store",
    "track_markers": "expertaug.recordings.markers.track",
    "unpack_markers": "expertaug.recordings.imports.ibm",
    "import_markers": "expertaug.recordings.imports.ibm",
    "measure_angles": "expertaug.recordings.angles.measure",
    "summarise_recordings": "expertaug.recordings.reports.summary",
    "plot_recording": "expertaug.recordings.reports.page",
    "overlay": "expertaug.recordings.reports.overlay",
    "split_chunks": "expertaug.recordings.chunks.cut",
    "plot_splits": "expertaug.recordings.reports.splits",
    "calibrate": "expertaug.recordings.angles.calibration",
    "simulate": "expertaug.systems.simulate",
    "train": "expertaug.learning.train",
    "augment": "expertaug.learning.augment",
    "finetune": "expertaug.learning.finetune",
    "during_training": "expertaug.evaluation.during_training",
    "evaluate": "expertaug.evaluation.evaluate",
    "tabulate": "expertaug.evaluation.tables",
    "plot": "expertaug.evaluation.plot",
    "study": "expertaug.evaluation.studies",
    "compare": "expertaug.evaluation.published",
    "overview": "expertaug.evaluation.overview",
}

# Mirroring to the tracking store changes no result; neither does translating the command line or leaving out a
# recording.
WITHOUT_EFFECT = {
    "expertaug.cli",
    "expertaug.commands",
    "expertaug.tracking.mlflow_mirror",
    "expertaug.tracking.mlflow_store",
    "expertaug.tracking.rebuild",
    "expertaug.tracking.store_link",
    "expertaug.tracking.store_lock",
    "expertaug.recordings.intake",
}


def sources(stage: str, extra: Iterable[str] = ()) -> list[str]:
    """Source files of a stage, relative to the working directory, sorted.

    Arguments:
        stage: a key of :data:`STAGES`.
        extra: modules that the configuration names: ``package.module`` or ``package.module:Class``.

    Raises:
        InputError: a module does not exist.
    """
    ignored = WITHOUT_EFFECT - {STAGES[stage]}
    files = set(_reachable(STAGES[stage], frozenset(ignored)))
    for name in extra:
        files |= _reachable(name.partition(":")[0], frozenset(ignored))
    return sorted(os.path.relpath(file) for file in files)


def modules(package: str) -> list[str]:
    """Names of the modules directly in a package of ``expertaug``."""
    folder = PACKAGE.joinpath(*package.split(".")[1:])
    return sorted(path.stem for path in folder.glob("*.py") if path.stem != "__init__")


@cache
def _reachable(name: str, ignored: frozenset[str]) -> frozenset[Path]:
    """Files of a module and of everything of this package and of its own that it imports, also inside functions."""
    own = name.split(".")[0]
    roots = {"expertaug": PACKAGE.parent}
    if own not in roots:
        file = find(name, name)
        roots[own] = file.parents[name.count(".") + (file.name == "__init__.py")]
    todo, found = [name], {}
    while todo:
        module = todo.pop()
        path = _path(module, roots.get(module.split(".")[0], PACKAGE.parent))
        if module in found or module in ignored or path is None:
            continue
        found[module] = path
        todo += [other for other in _imported(path, module) if other.split(".")[0] in roots]
        todo.append(module.rpartition(".")[0])
    if name not in found:
        raise InputError(name, "no such module of expertaug", "correct the name")
    return frozenset(found.values())


def _path(module: str, root: Path = PACKAGE.parent) -> Path | None:
    base = root.joinpath(*module.split("."))
    return next((p for p in (base.with_suffix(".py"), base / "__init__.py") if module and p.is_file()), None)


def find(where: str, name: str) -> Path:
    """File of the module that a configuration names as ``package.module`` or ``package.module:Class``.

    Raises:
        InputError: there is no such module.
    """
    module = name.partition(":")[0]
    own = _path(module)  # without importing its package, which would load torch
    if own is not None:
        return own
    try:
        found = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        found = None
    if found is None or not found.origin:
        raise InputError(where, f"no module '{module}'", "name a module that Python finds: is its package installed?")
    return Path(found.origin)


def parsed(path: Path) -> ast.Module:
    """The syntax tree of a Python file.

    Raises:
        InputError: it is no Python.
    """
    try:
        return ast.parse(path.read_text(encoding="utf-8"))
    except (SyntaxError, ValueError) as error:
        line = f":{error.lineno}" if getattr(error, "lineno", None) else ""
        raise InputError(f"{path}{line}", f"no Python ({getattr(error, 'msg', error)})", "correct that file") from error


@cache
def _imported(path: Path, module: str) -> tuple[str, ...]:
    """Modules that a file, which is ``module``, names in import statements."""
    names = []
    package = module.split(".") if path.name == "__init__.py" else module.split(".")[:-1]
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else []
            source = ".".join([*above, *([node.module] if node.module else [])])
            names += [source, *(f"{source}.{alias.name}" for alias in node.names)]
    return tuple(names)
