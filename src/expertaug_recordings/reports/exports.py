"""A recording's markers and angles in the formats that laboratories use."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from expertaug.errors import InputError
from expertaug.files import atomic
from expertaug_recordings.angles.quality import UNUSABLE
from expertaug_recordings.markers.appearance import ROLES
from expertaug_recordings.tables import PLACES, read_table

ANGLES = {"theta1": "deg", "theta2": "deg", "omega1": "deg/s", "omega2": "deg/s"}
SCORER = "expertaug"
MARKERS, COLUMNS = ("frame", "t", *PLACES, "quality"), ("t", *ANGLES, "quality", "source")
FILES = ("units.csv", "tracker.csv", "deeplabcut.csv")


@dataclass(frozen=True)
class Exports:
    """A recording's markers and angles for other programs.

    Attributes:
        units: a unit in each heading.
        tracker: the text of an export of the program Tracker of several point masses: a line ``#multi:``, one of their
            names, one of variables; x to the right and y up in px from the first pivot.
        deeplabcut: DeepLabCut's three heading rows (scorer, bodyparts, coords) with x and y in px from the top-left
            pixel and the quality as likelihood.
    """

    units: pd.DataFrame
    tracker: str
    deeplabcut: pd.DataFrame


def run_stage(markers: str | Path, angles: str | Path, folder: str | Path) -> None:
    """Stage: write a recording's markers and angles.

    Arguments:
        markers, angles: what the stage measure-angles read and wrote.
        folder: gets the three files of :class:`Exports`.

    Raises:
        InputError: a table is missing or not of this recording.
    """
    points = read_table(markers, MARKERS, made_by="track_markers")
    table = read_table(angles, COLUMNS, ("reason",))
    source = table["source"].to_numpy(int)
    if not ((source >= 0) & (source < len(points))).all():
        raise InputError(markers, f"{len(points)} frames, {angles} has {len(table)}", "run measure_angles again")
    exports = export_recording(points, table, markers)
    units, tracker, deeplabcut = (Path(folder) / name for name in FILES)
    with atomic(units) as temporary:
        exports.units.to_csv(temporary, index=False, float_format="%.9g")
    with atomic(tracker) as temporary:
        temporary.write_text(exports.tracker, encoding="utf-8", newline="")
    with atomic(deeplabcut) as temporary:
        exports.deeplabcut.to_csv(temporary, float_format="%.6g")


def export_recording(points: pd.DataFrame, table: pd.DataFrame, where: object = "markers") -> Exports:
    """A recording's markers and angles for other programs.

    Arguments:
        points: places of the markers, :data:`MARKERS`, of each analysed frame.
        table: of the angles, :data:`COLUMNS` and reason; ``source`` are rows of ``points``.
        where: what messages call the markers.

    Raises:
        InputError: no frame has a pivot.
    """
    units = _units(points.iloc[table["source"].to_numpy(int)], table)
    return Exports(units, _tracker(points, where), _deeplabcut(points))


def _units(points: pd.DataFrame, table: pd.DataFrame) -> pd.DataFrame:
    columns = {"t [s]": table["t"]}
    columns |= {f"{name} [{unit}]": np.rad2deg(table[name]) for name, unit in ANGLES.items()}
    columns |= {f"{name} [px]": points[name].to_numpy() for name in PLACES}
    columns |= {"quality [1]": table["quality"], "reason": table["reason"], "frame": points["frame"].to_numpy()}
    return pd.DataFrame(columns)


def _tracker(points: pd.DataFrame, where: object) -> str:
    """Times and one x and y a marker; what was not found is empty."""
    place = points[list(PLACES)].to_numpy().reshape(-1, 3, 2)
    seen = np.isfinite(place[:, 0]).all(1)
    if not seen.any():
        raise InputError(where, "no frame has a pivot", "check the tracking")
    moved = (place - place[int(np.argmax(seen)), 0]) * (1, -1)
    stream = io.StringIO(newline="")
    stream.write("#multi:\n")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["", *(cell for name in ROLES for cell in (name, ""))])
    writer.writerow(["t", *("x", "y") * len(ROLES)])
    for t, row in zip(points["t"].tolist(), moved.reshape(-1, 6).tolist(), strict=True):
        writer.writerow([f"{t:.9g}", *("" if np.isnan(v) else f"{v:z.4f}" for v in row)])
    return stream.getvalue()


def _deeplabcut(points: pd.DataFrame) -> pd.DataFrame:
    """A frame without a marker has likelihood 0 for it."""
    columns = pd.MultiIndex.from_product(
        [[SCORER], ROLES, ["x", "y", "likelihood"]], names=["scorer", "bodyparts", "coords"]
    )
    cells = []
    for name in ROLES:
        place = points[[f"{name}_x", f"{name}_y"]].to_numpy()
        present = np.isfinite(place).all(1)
        level = np.where(present, np.maximum(points["quality"].to_numpy(), UNUSABLE), UNUSABLE)
        cells.append(np.column_stack((place, level)))
    return pd.DataFrame(np.concatenate(cells, axis=1), index=points["frame"].to_numpy(), columns=columns)
