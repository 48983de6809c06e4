"""From the image to the plane of motion: what a lens and an oblique view do to places is undone before angles.

A camera's lens and view are told by pictures of a checkerboard, or a view askew by the arms alone: what turns on a
circle draws an ellipse in its image.

The lengths of both arms are the same in every direction and at every place of the plane of motion.  In the image, about
the pivot, a point x of that plane is seen where A x / (1 − g·x) is, A a stretch along two axes (oblique view from afar,
pixels that are not square) and g what is nearer to the camera and larger (oblique view from near).  Offsets of markers
from their hinges vary a length with the first harmonics of the angles, a stretch with the second
(:mod:`expertaug_recordings.angles.arms`), so that one is not taken for the other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import least_squares

from expertaug.errors import InputError
from expertaug_recordings.angles.arms import find_offsets
from expertaug_recordings.angles.marker_table import MarkerTable
from expertaug_recordings.angles.noise import spread
from expertaug_recordings.angles.quality import trust_tracker
from expertaug_recordings.names import list_pictures
from expertaug_recordings.settings import AngleKeys

WHERE = "recordings.angles.rectify"
WORST_PX = 2.0  # of a board's corners from where the camera would see them
MANY = 3  # pictures from which on a second coefficient of the lens can be told
MOST = 1500  # frames or a little more, which tell enough
PASSES, TRIMMED = 4, 4.0  # robust standard deviations beyond which a frame is left out
NEARER = 0.9  # of the spread of the arms' lengths: perspective that does not lower it as far is left out
LEAST_ARC = 60.0  # degrees over which the first arm must turn, or the second
MOST_STRETCH = 2.0
WORTH = 1.5  # by which factor the arms become steadier where a correction is proposed
LEAST_STRETCH = 1.004  # that is proposed: smaller ones change an angle by .1° at most


@dataclass(frozen=True)
class Board:
    """What pictures of a board tell.

    Attributes:
        size: width and height of the pictures in px.
        camera, lens: OpenCV's matrix (3, 3) and coefficients of distortion (5,).
        matrix: homography (3, 3) from px without the lens' distortion to px as if the first picture's board were seen
            face to face, where it is and as large as it is.
        error_px: root mean square by which the corners are off.
    """

    size: tuple[int, int]
    camera: np.ndarray
    lens: np.ndarray
    matrix: np.ndarray
    error_px: float

    def straighten(self, places: np.ndarray) -> np.ndarray:
        """Places (..., 2) in px without the lens' distortion; NaN stays."""
        flat = np.ascontiguousarray(places, np.float64).reshape(-1, 1, 2)
        finite = np.isfinite(flat).all((1, 2))
        out = np.full_like(flat, np.nan)
        if finite.any():
            out[finite] = cv2.undistortPoints(flat[finite], self.camera, self.lens, P=self.camera)
        return out.reshape(places.shape)


def read_board(path: str | Path, corners: tuple[int, int]) -> Board:
    """Calibrate with a picture, or a folder of them of which the first (by name) shows the board in the plane of motion
    or parallel to it.

    A single picture tells one coefficient of the lens; three and more, with the board held askew, two and the focal
    length.

    Arguments:
        corners: inner corners of the board, across and down.

    Raises:
        InputError: a picture cannot be read, shows no such board, or none that a camera would see so.
    """
    at = Path(path)
    files = list_pictures(at) if at.is_dir() else [at]
    if not files:
        raise InputError(f"{WHERE}.checkerboard", f"no picture in '{at}'", "give a picture, or a folder of them")
    seen, size = [], None
    for file in files:
        image = cv2.imdecode(np.fromfile(file, np.uint8), cv2.IMREAD_GRAYSCALE) if file.is_file() else None
        if image is None:
            raise InputError(f"{WHERE}.checkerboard", f"'{file}' is no picture", "give a picture, or a folder of them")
        if size not in (None, image.shape[::-1]):
            problem = f"{image.shape[1]}x{image.shape[0]} px, the first {size[0]}x{size[1]} px"
            raise InputError(file, problem, "give pictures of one size, the video's")
        size = image.shape[::-1]
        good, points = cv2.findChessboardCornersSB(image, corners, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
        if not good:
            remedy = f"set {WHERE}.corners to its inner corners, and let it be seen whole"
            raise InputError(file, f"no checkerboard of {corners[0]}x{corners[1]} inner corners", remedy)
        seen.append(points.reshape(-1, 2))
    return _calibrate(at, np.array(seen), size, corners)


def _calibrate(path: Path, seen: np.ndarray, size: tuple[int, int], corners: tuple[int, int]) -> Board:
    """From corners (pictures, k, 2) in px."""
    grid = np.stack(np.meshgrid(np.arange(corners[0]), np.arange(corners[1])), -1).reshape(-1, 2).astype(np.float32)
    flat = np.column_stack((grid, np.zeros(len(grid), np.float32)))
    camera = np.array([[1.2 * max(size), 0, (size[0] - 1) / 2], [0, 1.2 * max(size), (size[1] - 1) / 2], [0, 0, 1]])
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_ASPECT_RATIO
    flags |= cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3 | (cv2.CALIB_FIX_K2 if len(seen) < MANY else 0)
    error, camera, lens, *_ = cv2.calibrateCamera(
        [flat] * len(seen), list(seen.astype(np.float32)), size, camera, np.zeros(5), flags=flags
    )
    if not np.isfinite(error) or error > WORST_PX:
        raise InputError(path, f"the board's corners are off by {error:.1f} px", "give sharp pictures of a flat board")
    board = Board(size, camera, lens.ravel(), np.eye(3), float(error))
    straight = board.straighten(seen[0])
    way, _ = cv2.findHomography(straight, grid)
    return Board(size, camera, lens.ravel(), _similarity(grid, straight) @ way, float(error))


def _similarity(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Turn, scale and shift, and a reflection where the board was numbered from the other side, (3, 3), that take
    points (k, 2) nearest to others (Umeyama, 1991)."""
    middle = source.mean(0), target.mean(0)
    a, b = source - middle[0], target - middle[1]
    u, s, v = np.linalg.svd(b.T @ a)
    turn = u @ v * (s.sum() / np.square(a).sum())
    out = np.eye(3)
    out[:2, :2], out[:2, 2] = turn, middle[1] - turn @ middle[0]
    return out


@dataclass(frozen=True)
class View:
    """From the image to the plane of motion: about ``centre`` (x, y) in px, ``stretch`` (2, 2) symmetric with
    determinant 1, over 1 + ``nearer`` (2,) px⁻¹ times the place; ``spread`` are robust standard deviations of the arms'
    lengths as shares, (2,), before and after."""

    centre: np.ndarray
    stretch: np.ndarray
    nearer: np.ndarray
    spread: tuple[np.ndarray, np.ndarray]

    @property
    def matrix(self) -> np.ndarray:
        """The same as a homography (3, 3) of places in px."""
        to, back = np.eye(3), np.eye(3)
        to[:2, 2], back[:2, 2] = -self.centre, self.centre
        middle = np.eye(3)
        middle[:2, :2], middle[2, :2] = self.stretch, self.nearer
        return back @ middle @ to

    @property
    def gain(self) -> float:
        """By which factor the less steady arm becomes steadier."""
        before, after = self.spread
        return float(before.max() / max(after.max(), 1e-9))


def find_view(places: np.ndarray, usable: np.ndarray, offsets: bool) -> View | None:
    """The view by which the arms are steadiest; None where they turn too little to tell.

    Arguments:
        places: of pivot, joint and tip in px, (n, 3, 2); the pivot's are known in all frames.
        usable: (n,), frames that count.
        offsets: whether markers may be off their hinges.
    """
    seen = places[usable]
    seen = seen[:: max(1, len(seen) // MOST)]
    centre = np.median(seen[:, 0], axis=0)
    seen = seen - centre
    if max(_arc(np.diff(seen, axis=1)[:, k]) for k in (0, 1)) < LEAST_ARC:
        return None
    none = np.zeros(2)
    start = _steadiness(seen, offsets)
    stretch = _from_afar(np.diff(seen, axis=1))
    if stretch is None:
        return None
    afar = View(centre, stretch, none, (start, _steadiness(seen @ stretch, offsets)))
    stretch, nearer = _from_near(seen, stretch)
    near = View(centre, stretch, nearer, (start, _steadiness(_project(seen, stretch, nearer), offsets)))
    return near if near.spread[1].max() < NEARER * afar.spread[1].max() else afar


def _project(places: np.ndarray, stretch: np.ndarray, nearer: np.ndarray) -> np.ndarray:
    return places @ stretch / (1 + places @ nearer)[..., None]


def _steadiness(places: np.ndarray, offsets: bool) -> np.ndarray:
    """Spreads of the two lengths, as shares of them."""
    vectors = np.diff(places, axis=1)
    if offsets:
        vectors = find_offsets(vectors, np.ones(len(vectors), bool)).remove(vectors)
    length = np.linalg.norm(vectors, axis=-1)
    return spread(length) / np.median(length, axis=0)


def _arc(vectors: np.ndarray) -> float:
    """Degrees over which most of vectors (n, 2) turn, as lines: a stretch is the same in opposite directions."""
    angle = np.sort(np.rad2deg(np.arctan2(vectors[:, 0], vectors[:, 1])) % 180)
    return 180 - float(np.diff(np.append(angle, angle[0] + 180)).max())


def _from_afar(vectors: np.ndarray) -> np.ndarray | None:
    """Stretch by least squares of |v|² + p (x² − y²) + 2 q x y = l², l of either arm; None for an impossible one."""
    x, y = vectors[..., 0], vectors[..., 1]
    square = x**2 + y**2
    typical = np.median(square, axis=0)
    which = np.broadcast_to(np.eye(2), (len(vectors), 2, 2))
    design = np.concatenate((np.stack((x**2 - y**2, 2 * x * y), -1) / typical[:, None], -which), axis=-1).reshape(-1, 4)
    target = -(square / typical).ravel()
    used = np.ones(len(target), bool)
    for _ in range(PASSES):
        solution, *_ = np.linalg.lstsq(design[used], target[used], rcond=None)
        off = target - design @ solution
        used = np.abs(off) < TRIMMED * max(float(spread(off[used])), 1e-9)
    p, q = solution[:2]
    return _root(float(p), float(q))


def _root(p: float, q: float) -> np.ndarray | None:
    """The stretch whose square is [[1 + p, q], [q, 1 − p]], with determinant 1."""
    square = np.array([[1 + p, q], [q, 1 - p]])
    value, axis = np.linalg.eigh(square)
    if value[0] * MOST_STRETCH**2 < value[1]:
        return None
    root = (value / np.sqrt(value.prod())) ** 0.5
    return (axis * root) @ axis.T


def _from_near(places: np.ndarray, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stretch and perspective together, by robust least squares of the logarithms of the lengths."""
    size = float(np.median(np.linalg.norm(np.diff(places, axis=1), axis=-1)))
    square = stretch @ stretch
    square = square / (square.trace() / 2)
    first = [(square[0, 0] - square[1, 1]) / 2, square[0, 1], 0.0, 0.0]

    def lengths(x: np.ndarray) -> np.ndarray:
        root = _root(x[0], x[1])
        root = np.eye(2) if root is None else root
        below = np.maximum(1 + places @ x[2:4] / size, 0.1)
        return np.log(np.linalg.norm(np.diff(places @ root / below[..., None], axis=1), axis=-1))

    log_medians = np.median(lengths(np.array(first)), axis=0)
    noise = max(float(np.max(spread(lengths(np.array(first))))), 1e-6)
    solution = least_squares(
        lambda x: ((lengths(x) - x[4:]) / noise).ravel(),
        [*first, *log_medians],
        loss="soft_l1",
        x_scale="jac",
        max_nfev=60,
    ).x
    root = _root(solution[0], solution[1])
    return (stretch, np.zeros(2)) if root is None else (root, solution[2:4] / size)


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
    rectified = Rectified(by, stretch, direction, furthest, error, tuple(before.tolist()))
    return _with_places(markers, moved), rectified


def worth_it(markers: MarkerTable, usable: np.ndarray, offsets: bool) -> View | None:
    """The view that makes the arms enough steadier to be proposed; None for none."""
    complete = usable & np.isfinite(markers.places).all((1, 2))
    view = find_view(markers.places, complete, offsets) if complete.sum() else None
    if view is None or view.gain < WORTH or _stretch(view.matrix, view.centre)[0] < LEAST_STRETCH:
        return None
    return view


def project_markers(matrix: np.ndarray, markers: MarkerTable) -> MarkerTable:
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
        problem = f"has markers beyond {width}x{height} px, the size of the checkerboard's picture"
        raise InputError(path, problem, "give a picture as large as the video's")
