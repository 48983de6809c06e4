"""Oblique views and lenses are undone: angles are those of the plane of motion."""

import json
import re

import cv2
import numpy as np
import pandas as pd
import pytest
from pendulum_motion import MARKERS, markers, truth
from scipy.interpolate import LinearNDInterpolator

from expertaug.errors import InputError
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.angles.rectify import describe, find_view, through
from expertaug_recordings.angles.summary import RecordingSummary
from expertaug_recordings.reports.page import _heading
from expertaug_recordings.settings import MeasureAnglesJob, RectifyKeys
from nightly import others_slow

SIZE, FOCAL = (480, 480), 900.0
CAMERA = np.array([[FOCAL, 0, 239.5], [0, FOCAL, 239.5], [0, 0, 1]])
LENS = np.array([-0.25, 0.0, 0.0, 0.0, 0.0])


def camera(turn=(0.0, 0.0, 0.0), lens=None, far=1.0):
    """From places of the plane of motion in px (where it is seen face to face) to the image, and OpenCV's numbers."""
    focal = np.diag([far, far, 1]) @ CAMERA
    focal[:2, 2] = CAMERA[:2, 2]
    pose, move = np.deg2rad(turn), np.array([0.0, 0.0, FOCAL * far])
    lens = np.zeros(5) if lens is None else lens

    def see(places):
        flat = places.reshape(-1, 2) - 239.5
        return cv2.projectPoints(np.column_stack((flat, np.zeros(len(flat)))), pose, move, focal, lens)[0].reshape(
            places.shape
        )

    return see


def filmed(folder, see, noise=0.07, count=1600):
    y = truth()[0, :count]
    table = markers(y, noise=0.0)
    places = see(table[list(MARKERS)].to_numpy().reshape(-1, 3, 2)).reshape(-1, 6)
    table[list(MARKERS)] = places + noise * np.random.default_rng(0).normal(size=places.shape)
    table.to_csv(folder / "markers.csv", index=False)
    return y


def errors(folder, y, **rectify):
    """Medians of the errors of both angles in degrees, without what is constant, and the summary."""
    files = (folder / name for name in ("markers.csv", "angles.csv", "angles.json"))
    measure_angles(*files, MeasureAnglesJob(rectify=RectifyKeys(**rectify)))
    table = pd.read_csv(folder / "angles.csv")
    off = np.angle(np.exp(1j * (table[["theta1", "theta2"]].to_numpy() - y[:, :2])))
    off = np.rad2deg(off[(table["quality"] == 1).to_numpy()])
    return np.median(np.abs(off - np.median(off[:, 0])), axis=0), json.loads((folder / "angles.json").read_text())


def board(path, see, squares=(10, 7), side=40, offset=(20, 80), fine=4):
    """A picture of a checkerboard, drawn by the camera's own rays, so many times as fine and averaged."""
    width, height = ((n + 2) * side for n in squares)
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    paint = np.where(((u // side) + (v // side)) % 2, 230, 25)
    outside = (u < side) | (v < side) | (u >= width - side) | (v >= height - side)
    paint = np.where(outside, 230, paint).astype(np.uint8)
    # Forward: a dense grid of the board's points gives the map back by interpolation.
    grid = np.stack(np.meshgrid(np.arange(-60, 540, 4.0), np.arange(-60, 540, 4.0)), -1)
    image = see(grid)
    pixel = (np.stack(np.meshgrid(np.arange(SIZE[0] * fine), np.arange(SIZE[1] * fine)), -1) + 0.5) / fine - 0.5
    back = LinearNDInterpolator(image.reshape(-1, 2), grid.reshape(-1, 2), fill_value=-1e4)(pixel)
    shown = cv2.remap(
        paint,
        (back[..., 0] - offset[0] + side).astype(np.float32),
        (back[..., 1] - offset[1] + side).astype(np.float32),
        cv2.INTER_LINEAR,
        borderValue=128,
    )
    small = cv2.resize(shown, SIZE, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(path), small)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("turn", others_slow([[0, 12, 0], [20, 0, 0], [9, 9, 0]]))
@pytest.mark.parametrize("far", [1.0, 20.0])
def test_an_oblique_view_is_told_by_the_arms(tmp_path, turn, far):
    y = filmed(tmp_path, camera(turn, far=far))
    before, _ = errors(tmp_path, y)
    after, summary = errors(tmp_path, y, ellipse=True)
    assert (after < 0.03).all() and before.max() > 0.4
    assert summary["rectified"]["stretch"] > 1.01 and summary["usable_share"] > 0.98


def test_pixels_that_are_not_square(tmp_path):
    y = filmed(tmp_path, lambda places: places * (1.067, 1.0))
    after, summary = errors(tmp_path, y, ellipse=True)
    assert (after < 0.05).all() and summary["rectified"]["stretch"] == pytest.approx(1.067, abs=0.003)
    assert summary["rectified"]["direction_deg"] == pytest.approx(0, abs=2) or summary["rectified"][
        "direction_deg"
    ] == pytest.approx(180, abs=2)


def test_a_camera_that_faces_the_plane_is_left_alone(tmp_path):
    y = filmed(tmp_path, lambda places: places)
    after, summary = errors(tmp_path, y, ellipse=True)
    assert (after < 0.03).all() and summary["rectified"]["stretch"] < 1.002


@pytest.mark.slow
def test_a_checkerboard_undoes_lens_and_view(tmp_path):
    see = camera((0, 12, 0), LENS)
    picture = board(tmp_path / "board.png", see)
    y = filmed(tmp_path, see)
    before, _ = errors(tmp_path, y)
    after, summary = errors(tmp_path, y, checkerboard=str(picture), corners=(9, 6))
    assert (after < 0.03).all() and before.max() > 0.5
    assert summary["rectified"]["board_px"] < 0.3


@pytest.mark.slow
def test_the_lens_by_boards_that_are_held_anyhow_and_the_view_by_the_arms(tmp_path):
    (tmp_path / "boards").mkdir()
    for k, turn in enumerate([(25, 10, 5), (-20, 25, 0), (5, -30, 10), (15, 15, 40)]):
        board(tmp_path / "boards" / f"{k}.png", camera(turn, LENS), side=32, offset=(60, 110))
    y = filmed(tmp_path, camera((0, 12, 0), LENS))
    boards = {"checkerboard": str(tmp_path / "boards")}
    after, summary = errors(tmp_path, y, ellipse=True, **boards)
    assert (after < 0.03).all() and summary["rectified"]["by"] == "a checkerboard and the ellipse of the arms"
    page = _heading(RecordingSummary.load(tmp_path / "angles.json"))
    assert "View undone by a checkerboard and the ellipse of the arms, corners off by" in " ".join(page.split())


def test_what_a_board_cannot_tell_is_refused(tmp_path):
    y = filmed(tmp_path, lambda places: places)
    cv2.imwrite(str(tmp_path / "none.png"), np.full((480, 480), 90, np.uint8))
    with pytest.raises(InputError, match=r"none.png: no checkerboard of 9x6 inner corners; set recordings"):
        errors(tmp_path, y, checkerboard=str(tmp_path / "none.png"))
    with pytest.raises(InputError, match=r"nowhere.png' is no picture"):
        errors(tmp_path, y, checkerboard=str(tmp_path / "nowhere.png"))
    filmed(tmp_path, lambda places: places + 200)
    with pytest.raises(InputError, match=r"markers beyond 480x480 px, the size of the checkerboard's picture"):
        errors(tmp_path, y, checkerboard=str(board(tmp_path / "board.png", lambda places: places, fine=1)))


def test_arms_that_hardly_turn_tell_no_view(tmp_path):
    y = filmed(tmp_path, lambda places: places)
    table = pd.read_csv(tmp_path / "markers.csv")
    table[["joint_x", "joint_y"]] = 240 + 0.1 * (table[["joint_x", "joint_y"]] - 240) + (0, 100)
    table[["tip_x", "tip_y"]] = table[["joint_x", "joint_y"]].to_numpy() + np.array([0, 90])
    table.to_csv(tmp_path / "markers.csv", index=False)
    with pytest.raises(InputError, match=r"the arms turn too little to tell what they draw; set recordings"):
        errors(tmp_path, y, ellipse=True)


def test_the_view_is_the_one_by_which_the_arms_are_steadiest():
    theta = np.random.default_rng(0).uniform(-np.pi, np.pi, (300, 2))
    arms = np.stack((np.sin(theta), np.cos(theta)), axis=-1) * [[118.0], [90.0]]
    places = np.array([240.0, 238.0]) + np.concatenate((np.zeros((300, 1, 2)), np.cumsum(arms, axis=1)), axis=1)
    view = find_view(places * [1.06, 1.0], np.ones(300, bool), offsets=False)
    lengths = np.linalg.norm(np.diff(through(view.matrix, places * [1.06, 1.0]), axis=1), axis=2)
    assert np.ptp(lengths, axis=0) == pytest.approx(0, abs=1e-3) and view.gain > 100
    assert re.match(r"1\.060 times as long as wide, narrowest along (0|180) deg", describe(view))
    assert (
        find_view(places[np.abs(theta).max(1) < 0.4], np.ones((np.abs(theta).max(1) < 0.4).sum(), bool), False) is None
    )
