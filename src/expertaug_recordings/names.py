"""Names of recordings: that of a file without its suffix, or of a folder of pictures, as it stands in results, tables
and figures."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path, PurePath
from typing import TypeVar

from expertaug.errors import InputError
from expertaug.measurements.paths import natural_key

P = TypeVar("P", bound=PurePath)
MOST = 10_000  # recordings of a run
MEANT_OTHERWISE = "{}<>"  # by Snakemake, in any path
PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
FEWEST = 2  # pictures of a series: one is a contact sheet
TAKEN = (
    "archive",
    "summary.csv",
    "summary.md",
    "review.html",
    ".",
    "..",
)  # files and folders beside the recordings' in the results


def by_name(where: object, paths: Iterable[P]) -> dict[str, P]:
    """Files by the names of their recordings, in natural order.

    Arguments:
        where: the folder, archive or key that they come from, for messages.

    Raises:
        InputError: too many files, two of one name (capitals do not count: not every disk tells them apart), or a name
            that cannot be a recording's.
    """
    paths = sorted(paths)
    if len(paths) > MOST:
        raise InputError(where, f"{len(paths)} files", f"at most {MOST} recordings can be used")
    lowered: dict[str, P] = {}
    for path in paths:
        check_name(where, path)
        other = lowered.setdefault(path.stem.lower(), path)
        if other is not path:
            raise InputError(where, f"two files of one name: {other} and {path}", "rename or remove one")
    return {path.stem: path for path in sorted(paths, key=lambda path: natural_key(path.stem))}


def check_name(where: object, path: PurePath) -> None:
    """Refuse a file whose recording's name would be taken for something else on the way.

    Raises:
        InputError: it says how the file may be called.
    """
    name = path.stem
    if name in TAKEN or not name.isprintable() or any(c in MEANT_OTHERWISE for c in name):
        better = "".join("_" if c in MEANT_OTHERWISE or not c.isprintable() else c for c in name).strip(".")
        better = f"recording_{better}".rstrip("_") if better in (*TAKEN, "") else better
        remedy = f"a recording is called after its file: rename it, to {better + path.suffix!r} for instance"
        raise InputError(where, f"a file is called {path.name!r}", remedy)


def list_pictures(folder: Path) -> list[Path]:
    """Pictures of a folder in the natural order of their names."""
    pictures = (p for p in folder.iterdir() if p.suffix.lower() in PICTURES and p.is_file())
    return sorted(pictures, key=lambda p: natural_key(p.name))


def is_series(folder: Path) -> bool:
    """Whether a folder holds a series of pictures."""
    return folder.is_dir() and len(list_pictures(folder)) >= FEWEST
