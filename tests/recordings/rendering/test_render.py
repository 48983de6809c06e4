import math

import cv2
import numpy as np
import pytest

from expertaug.errors import InputError
from expertaug_recordings.rendering import scene
from expertaug_recordings.rendering.render import motion, poses
from expertaug_recordings.rendering.render import run_stage as render_recording
from expertaug_recordings.rendering.scene import Scene
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


def centroid(image, about, radius):
    y, x = np.indices(image.shape)
    inside = np.clip(radius - np.hypot(x - about[0], y - about[1]), 0, 1) * image
    return np.array([(inside * x).sum(), (inside * y).sum()]) / inside.sum()


@pytest.mark.slow
def test_marker_centres_are_exact_before_the_sensor(monkeypatch):
    """Without rods and stand, a marker looks the same turned by half a turn: its centroid is its centre."""
    monkeypatch.setattr(
        scene, "RODS", {name: (offsets, width, (0, 0, 0)) for name, (offsets, width, _) in scene.RODS.items()}
    )
    monkeypatch.setattr(scene, "STAND", ((0, 0, 0), 1.0))
    rng = np.random.default_rng(2)
    for _ in range(8):
        pivot = (238 + rng.uniform(-4, 4), 239 + rng.uniform(-4, 4))
        drawn = Scene(480, pivot, ARMS, 0, rng)
        state = np.array([np.pi + rng.uniform(-1, 1), np.pi + rng.uniform(-1, 1), 0, 0])
        pose = poses(state, pivot, ARMS, 90e-6)[0]
        scale = 480 / drawn.sensor
        light = drawn.clean([pose]).sum(axis=-1).astype(float)
        seen = drawn.frame([pose]).sum(axis=-1).astype(float)
        for centre in (pose.pivot, pose.joint, pose.tip):
            on_sensor = (np.array(centre) + 0.5) / scale - 0.5
            np.testing.assert_allclose(centroid(light, on_sensor, 17 / scale) * scale, on_sensor * scale, atol=0.01)
            np.testing.assert_allclose(centroid(seen, centre, 17), centre, atol=0.05)


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


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"speed": 1}, "rendered.speed: unknown key; did you mean 'seed'"),
        ({"launch": {"mass": 1}}, "rendered.launch.mass: unknown key"),
        ({"launch": {"energy": [300, 200]}}, r"launch.energy: found \[300.0, 200.0\]"),
        ({"rate_hz": "1e3"}, "rendered.rate_hz: found '1e3', which YAML takes for a text"),
        ({"image_size_px": 481}, "image_size_px: found 481; give a multiple of 2"),
        ({"duration_s": 0}, "duration_s: found 0"),
        ({"pivot_px": [600, 10]}, "pivot_px: found"),
        ({"crf": 60}, "crf: found 60"),
    ],
)
def test_bad_settings_are_named(settings, message):
    with pytest.raises(InputError, match=message):
        RenderVideoJob.from_mapping(settings)


def test_recording_outside_the_set_is_refused(tmp_path):
    with pytest.raises(InputError, match="recording 5 of 2"):
        render_recording(5, tmp_path / "v.mp4", tmp_path / "t.csv", RenderVideoJob(count=2))
    assert not any(tmp_path.iterdir())
