"""A camera's lens and view by pictures of a checkerboard."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from expertaug.errors import InputError
from expertaug_recordings.names import list_pictures

WHERE = "recordings.angles.rectify"
WORST_PX = 2.0  # of a board's corners from where the camera would see them
MANY = 3  # pictures from which on a second coefficient of the lens can be told


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
        known = np.isfinite(flat).all((1, 2))
        out = np.full_like(flat, np.nan)
        if known.any():
            out[known] = cv2.undistortPoints(flat[known], self.camera, self.lens, P=self.camera)
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
            found = f"{image.shape[1]}x{image.shape[0]} px, the first {size[0]}x{size[1]} px"
            raise InputError(file, found, "give pictures of one size, the video's")
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
