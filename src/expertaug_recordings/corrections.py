"""Markers that somebody has placed by hand: a CSV of corrections by recording and frame, and what they change."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from expertaug.errors import InputError
from expertaug.settings import Settings, key
from expertaug_recordings.markers.appearance import ROLES

if TYPE_CHECKING:
    import numpy as np

COLUMNS = ["recording", "frame", "marker", "x", "y"]
ALL = "all"
MOST = 2000  # of a recording: more are a matter of tracking


class Correction(Settings):
    """Where a marker is in a frame."""

    frame: Annotated[int, Field(ge=0)] = key(..., "number of the analysed frame, as in markers.csv")
    marker: Literal["pivot", "joint", "tip", "all"] = key(..., "all, without x and y = the frame is not to be used")
    x: float | None = key(None, "px from the centre of the top-left pixel, to the right; null = not to be seen", "px")
    y: float | None = key(None, "downwards", "px")


def read_corrections(path: str | Path) -> dict[str, list[Correction]]:
    """Corrections by recording.

    Arguments:
        path: CSV of recording, frame, marker (pivot, joint, tip, all), x, y (px; both empty: the marker cannot be seen,
            or with all: the frame is not to be used).

    Raises:
        InputError: it cannot be read, or a row says nothing that can be done; with its number.
    """
    import pandas as pd

    try:
        table = pd.read_csv(path, dtype={"recording": str, "marker": str}, skipinitialspace=True, usecols=COLUMNS)
    except FileNotFoundError as error:
        raise InputError(path, "no such file", f"give a CSV of {', '.join(COLUMNS)}") from error
    except (ValueError, OSError) as error:
        raise InputError(path, f"no table of corrections ({error})", f"give a CSV of {', '.join(COLUMNS)}") from error
    corrections: dict[str, list[Correction]] = {}
    for number, row in enumerate(table.itertuples(index=False), 2):
        where = f"{path}, row {number}"
        try:
            place = [None if pd.isna(v) else float(v) for v in (row.x, row.y)]
            frame = int(row.frame)
        except (TypeError, ValueError) as error:
            raise InputError(where, f"found {row.frame!r}, {row.x!r}, {row.y!r}", "give numbers") from error
        if frame != row.frame or frame < 0 or row.marker not in (*ROLES, ALL) or pd.isna(row.recording):
            found_here = f"found frame {row.frame!r}, marker {row.marker!r}"
            raise InputError(where, found_here, f"give a frame's number and {', '.join(ROLES)} or {ALL}")
        if (place[0] is None) != (place[1] is None) or (row.marker == ALL and place[0] is not None):
            raise InputError(where, f"found {row.x!r}, {row.y!r}", "give x and y, or neither; neither with all")
        mine = corrections.setdefault(str(row.recording), [])
        mine.append(Correction(frame=frame, marker=row.marker, x=place[0], y=place[1]))
        if len(mine) > MOST:
            raise InputError(path, f"more than {MOST} corrections of {row.recording}", "mend the tracking's settings")
    return corrections


def correct(
    where: object, frame: np.ndarray, place: np.ndarray, corrections: Sequence[Correction]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Put markers where they were seen by hand.

    Arguments:
        where: the recording, for messages.
        frame: numbers (n,) of the frames.
        place: pivot, joint and tip (n, 3, 2) in px.
        corrections: in order; the last of a marker counts.

    Returns:
        places (n, 3, 2), frames (n,) that were corrected, and frames (n,) that are not to be used.

    Raises:
        InputError: there is no such frame.
    """
    import numpy as np

    place, touched, dismissed = place.copy(), np.zeros(len(frame), bool), np.zeros(len(frame), bool)
    rows = {int(number): row for row, number in enumerate(frame)}
    for correction in corrections:
        if correction.frame not in rows:
            raise InputError(
                where, f"a correction of frame {correction.frame}", f"its frames are {frame[0]} to {frame[-1]}"
            )
        row = rows[correction.frame]
        if correction.marker == ALL:
            dismissed[row] = True
            continue
        touched[row] = True
        place[row, ROLES.index(correction.marker)] = np.nan if correction.x is None else (correction.x, correction.y)
    return place, touched & ~dismissed, dismissed
