"""Marker CSVs in the layout of IBM's "Double Pendulum Chaotic" dataset, from a folder or from its archive."""

from __future__ import annotations

import csv as csv_format
import io
import re
import shutil
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

import numpy as np
import pandas as pd

from expertaug.errors import InputError
from expertaug.files import atomic, sha256
from expertaug_recordings.names import P, by_name
from expertaug_recordings.settings import ImportMarkersJob, UnpackMarkersJob
from expertaug_recordings.tables import PLACES
from expertaug_recordings.unpacking import unpack

IBM_FOLDER = "dpc_dataset_csv"  # the dataset's archive keeps its marker CSVs in original/dpc_dataset_csv/
IBM_COLUMNS = ("y_red", "x_red", "y_green", "x_green", "y_blue", "x_blue")
MAX_CSV_BYTES = 2**26  # an hour and a half at 400 Hz
MAX_PX = 1e5  # further from an image's corner lies no marker
DIGITS = re.compile(r'[\d.eE+\-,"\s]*', re.ASCII)  # all that a table of numbers is written with


def list_marker_files(path: str | Path) -> dict[str, Path]:
    """Marker CSVs of a folder by name (the file's stem), in natural order: 2 before 10.

    Looks into subfolders as well; where one is called ``dpc_dataset_csv``, as in the IBM archive, only there.

    Raises:
        InputError: no such folder, no CSV in it, or two files of one name.
    """
    path = Path(path)
    if not path.is_dir():
        raise InputError(path, "no such folder", "give a folder of marker CSVs")
    return _by_name(path, (p for p in path.rglob("*") if p.is_file() and _is_marker_file(p.relative_to(path))))


def unpack_archive(archive: str | Path, folder: str | Path, job: UnpackMarkersJob) -> dict[str, Path]:
    """Unpack the marker CSVs of a .tar.gz or .zip, and nothing else, into ``folder``, which is replaced as a whole.

    Arguments:
        archive: the file.
        folder: where to; it appears only when everything went well.
        job: the archive's checksum.

    Returns:
        what :func:`list_marker_files` finds there.

    Raises:
        InputError: a missing or damaged archive, a wrong checksum, a member that would land outside of ``folder``
            (``..``, an absolute path, a link), no CSV, two CSVs of one name or a folder that cannot be written.
    """
    archive, folder = Path(archive), Path(folder)
    if not archive.is_file():
        raise InputError(archive, "no such file", "give the dataset's .tar.gz or .zip")
    if job.sha256 is not None and (digest := sha256(archive)) != job.sha256.lower():
        raise InputError(archive, f"SHA-256 is {digest}", f"expected {job.sha256}: get the archive again")
    temporary = folder.with_name(f".{folder.name}.unpacking")  # one name: what a killed job left goes with the next
    try:
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir(parents=True)
    except OSError as error:
        raise InputError(folder, f"cannot be written ({error.strerror})", "choose a writable results folder") from error
    try:
        unpack(archive, temporary / "new", lambda members: _by_name(archive, filter(_is_marker_file, members)).values())
        if folder.exists():
            folder.rename(temporary / "old")
        (temporary / "new").rename(folder)
    except OSError as error:
        raise InputError(folder, f"cannot be written ({error.strerror or error})", "free some space") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return list_marker_files(folder)


def import_markers(csv: str | Path, output: str | Path, job: ImportMarkersJob) -> None:
    """Convert one IBM marker CSV to a ``markers.csv``.

    Arguments:
        csv: no header; a row per frame of y_red, x_red, y_green, x_green, y_blue, x_blue: vertical (downwards) first,
            in pixels times ``scale`` plus ``offset``.
        output: frame, t (s), pivot_x ... tip_y (px), quality (1), reason (empty).
        job: what the numbers mean.

    Raises:
        InputError: a missing column, text, NaN or points that make no arm; with row and column, both from 1.
    """
    path = Path(csv)
    table = convert_markers(parse_markers(_read_text(path), path), job, path)
    with atomic(output) as temporary:
        table.to_csv(temporary, index=False, float_format="%.9g")


def convert_markers(raw: np.ndarray, job: ImportMarkersJob, where: object = "markers") -> pd.DataFrame:
    """The table of markers of an IBM marker CSV.

    Arguments:
        raw: the numbers of its six columns, (n, 6).
        job: what they mean.
        where: what messages call them.

    Raises:
        InputError: points that are no pixels, or make no arm; with row and column, both from 1.
    """
    _check_arms(where, raw, job)
    px = (raw - job.offset) / job.scale
    frame = np.arange(len(px))
    table = pd.DataFrame({"frame": frame, "t": frame / job.rate_hz})
    for name, column in zip(PLACES, (1, 0, 3, 2, 5, 4), strict=True):
        table[name] = px[:, column]
    table["quality"], table["reason"] = 1, ""
    return table


def _is_marker_file(path: PurePosixPath | Path) -> bool:
    hidden = any(part.startswith(".") or part == "__MACOSX" for part in path.parts)
    return path.suffix.lower() == ".csv" and not hidden


def _by_name(where: Path, paths: Iterable[P]) -> dict[str, P]:
    """Marker files by name; the IBM folder wins over anything beside it."""
    paths = list(paths)
    paths = [p for p in paths if IBM_FOLDER in p.parts] or paths
    if not paths:
        raise InputError(where, "no marker CSV in it", "expected files like 0.csv")
    return by_name(where, paths)


def _read_text(path: Path) -> str:
    try:
        if path.stat().st_size > MAX_CSV_BYTES:
            raise InputError(path, f"is larger than {MAX_CSV_BYTES >> 20} MiB", "split the recording")
        with path.open(newline="", encoding="utf-8-sig") as stream:
            return stream.read()
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "give a marker CSV") from error
    except UnicodeDecodeError as error:
        raise InputError(path, f"not a CSV ({error})", f"expected rows of {','.join(IBM_COLUMNS)}") from error


def parse_markers(text: str, where: object = "markers") -> np.ndarray:
    """The six columns of a CSV's text as (n, 6) float64, checked cell by cell.

    Raises:
        InputError: a missing column, text or NaN; with row and column, both from 1.
    """
    try:
        rows = list(csv_format.reader(io.StringIO(text, newline="")))
    except csv_format.Error as error:
        raise InputError(where, f"not a CSV ({error})", f"expected rows of {','.join(IBM_COLUMNS)}") from error
    while rows and not rows[-1]:
        rows.pop()
    if not rows:
        raise InputError(where, "no rows in it", f"expected rows of {','.join(IBM_COLUMNS)}")
    for number, row in enumerate(rows, 1):
        if len(row) != len(IBM_COLUMNS):
            column = f"column {IBM_COLUMNS[len(row)]} is missing" if len(row) < len(IBM_COLUMNS) else "too many columns"
            raise InputError(where, f"row {number}: {column} ({len(row)} found)", f"expected {','.join(IBM_COLUMNS)}")
    try:
        values = np.array(rows, dtype=np.float64) if DIGITS.fullmatch(text) else None
    except ValueError:
        values = None
    if values is None or not np.isfinite(values).all():
        row, column, cell = next(
            (r, c, cell) for r, cells in enumerate(rows) for c, cell in enumerate(cells) if not _is_number(cell)
        )
        raise InputError(
            where, f"row {row + 1}, column {IBM_COLUMNS[column]}: '{cell}' is no number", "expected numbers, no header"
        )
    return values


def _is_number(text: str) -> bool:
    try:
        return DIGITS.fullmatch(text) is not None and bool(np.isfinite(float(text)))
    except ValueError:
        return False


def _check_arms(where: object, raw: np.ndarray, job: ImportMarkersJob) -> None:
    far = np.abs(raw - job.offset) > MAX_PX * job.scale
    if far.any():
        row, column = np.argwhere(far)[0]
        problem = f"row {row + 1}, column {IBM_COLUMNS[column]}: {raw[row, column]:g}"
        raise InputError(where, problem, f"expected pixels times {job.scale:g}, within {MAX_PX:g} px")
    points = raw.reshape(-1, 3, 2)
    for arm, columns in ((0, "y_green,x_green"), (1, "y_blue,x_blue")):
        length = np.linalg.norm(points[:, arm + 1] - points[:, arm], axis=1) / job.scale
        middle = float(np.median(length))
        remedy = "the points must make two arms of constant length; are the columns y,x of red, green, blue?"
        if (length == 0).any():
            row = int(np.argmax(length == 0)) + 1
            raise InputError(where, f"row {row}, columns {columns}: arm {arm + 1} has no length", remedy)
        off = np.abs(length / middle - 1) > job.arm_tolerance
        if off.mean() > job.arm_outliers:
            row = int(np.argmax(off)) + 1
            problem = (
                f"arm {arm + 1} is {length[row - 1]:.1f} px, not {middle:.1f}; {off.mean():.0%} of the rows are off"
            )
            raise InputError(where, f"row {row}, columns {columns}: {problem}", remedy)
