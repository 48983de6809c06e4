import math

import cv2
import numpy as np
import pytest
from light import centroid

from expertaug.errors import InputError
from expertaug_recordings.rendering.render import motion, poses
from expertaug_recordings.rendering.render import run_stage as render_recording
from expertaug_recordings.settings import RenderVideoJob

SHORT = RenderVideoJob(duration_s=0.1, seed=3)
ARMS = (117.8, 90.1)


def read_all(path):
    capture = cv2.VideoCapture(str(path))
    frames = []
    while (got := capture.read())[0]:
        frames.append(got[1])
    return np.stack(frames)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rendered")
    render_recording(1, folder / "video.mp4", folder / "truth.csv", SHORT)
    return folder


def test_motion_blur_is_the_mean_of_the_exposure():
    state = np.array([2.0, 1.0, 25.0, 60.0])
    still, moving = (poses(state, (240, 240), ARMS, exposure) for exposure in (1e-6, 90e-6))
    assert (len(still), len(moving)) == (1, 2)
    np.testing.assert_allclose(np.mean([p.tip for p in moving], axis=0), still[0].tip, atol=0.01)
    spread = np.linalg.norm(np.subtract(moving[1].tip, moving[0].tip)) / 2
    speed = np.linalg.norm(
        ARMS[0] * 25 * np.array([math.cos(2), -math.sin(2)]) + ARMS[1] * 60 * np.array([math.cos(1), -math.sin(1)])
    )
    assert spread == pytest.approx(speed * 90e-6 / math.sqrt(12), rel=0.01)


def test_same_seed_gives_the_same_bytes(rendered, tmp_path):
    two = SHORT.model_copy(update={"count": 2})
    render_recording(1, tmp_path / "video.mp4", tmp_path / "truth.csv", two)
    render_recording(0, tmp_path / "other.mp4", tmp_path / "other.csv", SHORT)
    assert (tmp_path / "video.mp4").read_bytes() == (rendered / "video.mp4").read_bytes()
    assert (tmp_path / "truth.csv").read_bytes() == (rendered / "truth.csv").read_bytes()
    assert (tmp_path / "other.mp4").read_bytes() != (rendered / "video.mp4").read_bytes()


def test_truth_is_where_the_markers_are(rendered):
    truth = np.genfromtxt(rendered / "truth.csv", delimiter=",", names=True)
    frames = read_all(rendered / "video.mp4")
    assert frames.shape == (40, 480, 480, 3)
    np.testing.assert_allclose(truth["t"], np.arange(40) / 400)
    for k in (0, 20, 39):
        for name in ("pivot", "joint", "tip"):
            x, y = truth[f"{name}_x"][k], truth[f"{name}_y"][k]
            disk = cv2.morphologyEx(frames[k].max(axis=2), cv2.MORPH_OPEN, np.ones((7, 7)))
            np.testing.assert_allclose(centroid((disk > 90).astype(float), (x, y), 17), (x, y), atol=0.6)


def test_frames_look_like_the_real_one(rendered):
    """Numbers of the published video frame: mean B, G, R 2.43, 1.95, 1.54; 94.7 % black; 1.45 % brighter than 50."""
    frames = read_all(rendered / "video.mp4")
    np.testing.assert_allclose(frames.mean(axis=(0, 1, 2)), [2.43, 1.95, 1.54], rtol=0.15)
    brightest = frames.max(axis=3)
    assert 0.92 < (brightest == 0).mean() < 0.97
    assert 0.013 < (brightest > 50).mean() < 0.019
    _, _, pivot = motion(1, SHORT)
    x, y = (round(v) for v in pivot)
    np.testing.assert_allclose(
        np.median(frames[:, y + 4 : y + 8, x + 4 : x + 8], axis=(0, 1, 2)), [125, 108, 166], atol=20
    )
    np.testing.assert_allclose(
        np.median(frames[:, y - 8 : y - 4, x + 4 : x + 8], axis=(0, 1, 2)), [255, 253, 205], atol=12
    )


def test_recording_outside_the_set_is_refused(tmp_path):
    with pytest.raises(InputError, match="recording 5 of 2"):
        render_recording(5, tmp_path / "v.mp4", tmp_path / "t.csv", RenderVideoJob(count=2))
    assert not any(tmp_path.iterdir())
