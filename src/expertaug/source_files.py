"""Which source files a module is made of, and which installed packages compute its numbers.

Files are found by following the import statements, without importing anything: the workflow asks for every rule
whenever it starts, and a checkpoint's fingerprint asks the same.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import re
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from itertools import chain
from pathlib import Path

from expertaug.errors import InputError
from expertaug.files import sha256

PACKAGE = Path(__file__).resolve().parent
PACKAGES = ("expertaug", "expertaug_recordings")  # beside each other
# Where the workflow may lie: the checkout, and where setup.py copies it into a wheel.
PROJECTS = (PACKAGE.parents[1], PACKAGE / "project")

# Mirroring to the tracking store changes no result; neither does translating the command line
# or leaving out a recording.
WITHOUT_EFFECT = frozenset(
    f"{package}.{name}"
    for package, names in {
        "expertaug": (
            "cli",
            "commands",
            "stages",
            "tracking.rebuild",
            "tracking.store",
            "tracking.sync",
        ),
        "expertaug_recordings": ("intake",),
    }.items()
    for name in names
)

# Packages whose version may change a number: what is imported → what may be installed to bring it.
NUMERIC = {
    "torch": ("torch",),
    "torchdiffeq": ("torchdiffeq",),
    "numpy": ("numpy",),
    "scipy": ("scipy",),
    "cv2": ("opencv-python-headless", "opencv-python"),
    "av": ("av",),
    "zuko": ("zuko",),
}


def files(modules: Iterable[str]) -> list[Path]:
    """Source files of these modules and of all that they import of this package and of their own, sorted.

    Arguments:
        modules: ``package.module`` or ``package.module:Class``; the first is never left out as without effect.

    Raises:
        InputError: a module does not exist.
    """
    return sorted(path for _, path in _all(modules))


def digest(modules: Iterable[str]) -> str:
    """A digest of what these modules and all that they import of this package and of their own say.

    Arguments:
        modules: as of :func:`files`.
    """
    return _digest_of(tuple(sorted((module, _content(path)) for module, path in _all(modules))))


def versions(modules: Iterable[str]) -> list[str]:
    """Installed versions of the numeric packages that these modules and all that they import use: ``numpy 2.4.6``."""
    used = frozenset().union(*(_list_numeric(path, module) for module, path in _all(modules)))
    return [_find_version(name) for name in NUMERIC if name in used]


def libraries() -> list[str]:
    """What any module of this package imports from elsewhere, wherever it does, sorted."""
    names: set[str] = set()
    for path in chain.from_iterable((PACKAGE.parent / package).rglob("*.py") for package in PACKAGES):
        module = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
        names.update(_list_imports(path, module.removesuffix(".__init__")))
    return sorted(name for name in names if name.partition(".")[0] not in PACKAGES)


def find(where: str, name: str) -> Path:
    """The file of the module that a configuration names as ``package.module`` or ``package.module:Class``.

    Raises:
        InputError: there is no such module.
    """
    module = name.partition(":")[0]
    own = _path(module)  # without importing its package, which would load torch
    if own is not None:
        return own
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        spec = None
    if spec is None or not spec.origin:
        raise InputError(where, f"no module '{module}'", "name a module that Python finds: is its package installed?")
    return Path(spec.origin)


def _all(modules: Iterable[str]) -> frozenset[tuple[str, Path]]:
    return _all_of(tuple(name.partition(":")[0] for name in modules))


@cache
def _all_of(names: tuple[str, ...]) -> frozenset[tuple[str, Path]]:
    ignored = WITHOUT_EFFECT - set(names[:1])
    return frozenset().union(*(_reachable(name, ignored) for name in names))


@cache
def _reachable(name: str, ignored: frozenset[str]) -> frozenset[tuple[str, Path]]:
    """A module and everything of this package and of its own that it imports, also inside functions: names, files."""
    own = name.split(".")[0]
    roots = dict.fromkeys(PACKAGES, PACKAGE.parent)
    if own not in roots:
        file = find(name, name)
        roots[own] = file.parents[name.count(".") + (file.name == "__init__.py")]
    todo, paths = [name], {}
    while todo:
        module = todo.pop()
        path = _path(module, roots.get(module.split(".")[0], PACKAGE.parent))
        if module in paths or module in ignored or path is None:
            continue
        paths[module] = path
        todo += [other for other in _list_imports(path, module) if other.split(".")[0] in roots]
        todo.append(module.rpartition(".")[0])
    if name not in paths:
        raise InputError(name, "no such module of expertaug", "correct the name")
    return frozenset(paths.items())


@cache
def _content(path: Path) -> str:
    return sha256(path)


@cache
def _digest_of(parts: tuple[tuple[str, str], ...]) -> str:
    return hashlib.sha256("\n".join(map(" ".join, parts)).encode()).hexdigest()


@cache
def _path(module: str, root: Path = PACKAGE.parent) -> Path | None:
    base = root.joinpath(*module.split("."))
    return next((p for p in (base.with_suffix(".py"), base / "__init__.py") if module and p.is_file()), None)


@cache
def _list_imports(path: Path, module: str) -> tuple[str, ...]:
    """Modules that a file, which is ``module``, names in import statements.

    Raises:
        InputError: it is no Python.
    """
    text = path.read_text(encoding="utf-8-sig")  # as Python reads it
    if module.split(".")[0] not in PACKAGES:
        _check_syntax(path, text)
    names = []
    package = module.split(".") if path.name == "__init__.py" else module.split(".")[:-1]
    for source, imported, modules in _IMPORT.findall(_TEXT.sub(_without_text, text)):
        if modules:
            names += _without_new_names(modules)
            continue
        named = source.replace(" ", "").lstrip(".")
        level = len(source.replace(" ", "")) - len(named)
        above = package[: len(package) + 1 - level] if level else []
        whole = ".".join([*above, *([named] if named else [])])
        names += [whole, *(f"{whole}.{name}" for name in _without_new_names(imported.strip("()")))]
    return tuple(names)


@cache
def _list_numeric(path: Path, module: str) -> frozenset[str]:
    return frozenset(name.partition(".")[0] for name in _list_imports(path, module)) & NUMERIC.keys()


# Import statements are found by their text: syntax trees of the whole package cost a dry run a second.  Where no string
# and no comment is left, only such a statement has these words at its beginning.
_TEXT = re.compile(
    r'''"""(?:\\.|[^\\])*?"""|\'{3}(?:\\.|[^\\])*?\'{3}|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'|\#[^\n]*|\\\n''',
    re.DOTALL,
)
_IMPORT = re.compile(
    r"(?:^|[:;])[ \t]*(?:from\b[ \t]*([.\w \t]+?)[ \t]*\bimport\b[ \t]*(\([^)]*\)|[^\n;(]+)|import[ \t]+([^\n;]+))",
    re.MULTILINE,
)


def _without_text(found: re.Match[str]) -> str:
    return " " if found[0].startswith("\\") else "" if found[0].startswith("#") else "''"


def _without_new_names(listed: str) -> list[str]:
    """``a`` and ``b`` of ``a as x, b``."""
    return [name.split()[0] for name in listed.split(",") if name.strip()]


def _check_syntax(path: Path, text: str) -> None:
    try:
        ast.parse(text)
    except (SyntaxError, ValueError) as error:
        line = f":{error.lineno}" if getattr(error, "lineno", None) else ""
        raise InputError(f"{path}{line}", f"no Python ({getattr(error, 'msg', error)})", "correct that file") from error


@cache
def _find_version(name: str) -> str:
    for distribution in NUMERIC[name]:
        try:
            return f"{distribution} {version(distribution)}"
        except PackageNotFoundError:
            continue
    return f"{name} of an unknown version"


def project() -> Path | None:
    """The folder that holds Snakefile, workflow/, config/ and profiles/; None where this package has none."""
    return next((path for path in PROJECTS if (path / "config" / "config.yaml").is_file()), None)
