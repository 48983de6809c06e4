"""From the image to the plane of motion: what a lens and an oblique view do to places is undone before angles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug_recordings.angles.checkerboard import WHERE, Board, read_board
from expertaug_recordings.angles.ellipse import View, find_view
from expertaug_recordings.angles.marker_table import MarkerTable
from expertaug_recordings.angles.quality import trust_tracker
from expertaug_recordings.settings import AngleKeys

WORTH = 1.5  # by which factor the arms become steadier where a correction is proposed
LEAST_STRETCH = 1.004  # that is proposed: smaller ones change an angle by .1° at most


@dataclass(frozen=True)
class Rectified:
    """What was done to the places of a recording's markers.

    Attributes:
        by: what told it.
        stretch: by how much more the plane is seen larger in one direction at the pivot than across it, 1 for not at
            all; ``direction_deg`` of the smaller scale, 0 down, 90 right.
        moved_px: the furthest that a marker was moved.
        board_px: by how much the corners of the checkerboard are off; None without one.
        arms_before: spreads of the arms' lengths as shares of them, without the correction.
    """

    by: str
    stretch: float
    direction_deg: float
    moved_px: float
    board_px: float | None
    arms_before: tuple[float, float]


def rectify(path: Path, markers: MarkerTable, options: AngleKeys) -> tuple[MarkerTable, Rectified | None]:
    """The markers as a camera without distortion sees them that faces the plane of motion; None where nothing is asked.

    Raises:
        InputError: the pictures of a board cannot be used, or the arms turn too little to tell an ellipse.
    """
    chosen = options.rectify
    if chosen.checkerboard is None and not chosen.ellipse:
        return markers, None
    places = seen = markers.places
    matrix, board = np.eye(3), None
    if chosen.checkerboard is not None:
        board = read_board(chosen.checkerboard, chosen.corners)
        _require_inside(path, places, board)
        seen = board.straighten(places)
        matrix = board.matrix
    usable, _ = trust_tracker(markers)
    usable &= np.isfinite(seen).all((1, 2))
    if chosen.ellipse:
        view = find_view(seen, usable, options.model_offsets) if usable.any() else None
        if view is None:
            remedy = f"set {WHERE}.ellipse to false, or give a checkerboard"
            raise InputError(path, "the arms turn too little to tell what they draw", remedy)
        matrix = view.matrix
    moved = through(matrix, seen)
    length = np.linalg.norm(np.diff(places[usable], axis=1), axis=-1)
    before = np.std(length, axis=0) / np.median(length, axis=0)
    furthest = float(np.nanmax(np.linalg.norm(moved - places, axis=-1)))
    stretch, direction = _stretch(matrix, np.nanmedian(seen[:, 0], axis=0))
    by = " and ".join((["a checkerboard"] if board else []) + (["the ellipse of the arms"] if chosen.ellipse else []))
    error = None if board is None else board.error_px
    found = Rectified(by, stretch, direction, furthest, error, tuple(before.tolist()))
    return _with_places(markers, moved), found


def worth_it(markers: MarkerTable, usable: np.ndarray, offsets: bool) -> View | None:
    """The view that makes the arms enough steadier to be proposed; None for none."""
    known = usable & np.isfinite(markers.places).all((1, 2))
    view = find_view(markers.places, known, offsets) if known.sum() else None
    if view is None or view.gain < WORTH or _stretch(view.matrix, view.centre)[0] < LEAST_STRETCH:
        return None
    return view


def seen_through(matrix: np.ndarray, markers: MarkerTable) -> MarkerTable:
    """Markers with their places through a homography (3, 3)."""
    return _with_places(markers, through(matrix, markers.places))


def _with_places(markers: MarkerTable, places: np.ndarray) -> MarkerTable:
    pivot, joint, tip = places.swapaxes(0, 1)
    return replace(markers, pivot=pivot, joint=joint, tip=tip)


def through(matrix: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Places (..., 2) through a homography (3, 3)."""
    moved = places @ matrix[:2, :2].T + matrix[:2, 2]
    return moved / (places @ matrix[2, :2] + matrix[2, 2])[..., None]


def describe(view: View) -> str:
    """What the arms draw, in words."""
    stretch, direction = _stretch(view.matrix, view.centre)
    return f"{stretch:.3f} times as long as wide, narrowest along {direction:.0f} deg"


def _stretch(matrix: np.ndarray, place: np.ndarray) -> tuple[float, float]:
    """Ratio of the scales at a place, and in degrees the direction that is seen smaller."""
    step = 1e-3
    corners = through(matrix, place + step * np.array([[0, 0], [1, 0], [0, 1]]))
    _, scale, axes = np.linalg.svd((corners[1:] - corners[0]).T / step)
    x, y = axes[0]  # enlarged most by the correction
    return float(scale[0] / scale[1]), float(np.rad2deg(np.arctan2(x, y)) % 180)


def _require_inside(path: Path, places: np.ndarray, board: Board) -> None:
    """A board's picture of another size than the video's is refused where it can be told."""
    width, height = board.size
    if np.nanmax(places[..., 0]) > width or np.nanmax(places[..., 1]) > height:
        found = f"has markers beyond {width}x{height} px, the size of the checkerboard's picture"
        raise InputError(path, found, "give a picture as large as the video's")
