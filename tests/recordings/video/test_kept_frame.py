"""Patches of a kept frame are the image's to the bit, whatever the colours mean and wherever they lie."""

import itertools

import numpy as np
import pytest
from av.video.reformatter import VideoReformatter

from expertaug_recordings.markers.geometry import estimate_geometry
from expertaug_recordings.markers.tracker import track_frames
from expertaug_recordings.rendering.render import run_stage as render_recording
from expertaug_recordings.settings import ExtractFramesJob, RenderVideoJob, TrackMarkersJob
from expertaug_recordings.video.frame_store import FrameStore
from expertaug_recordings.video.frame_store import run_stage as extract_frames
from expertaug_recordings.video.pixel_layout import KeptFrame, Layout

WIDTH, HEIGHT = 100, 84
INSIDE = [(0, 0), (44, 30), (WIDTH - 40, HEIGHT - 40), (2, 10)]
ACROSS = [(-14, -2), (80, 60), (WIDTH - 2, 20), (30, -38)]
BEYOND = [(-200, 10), (WIDTH + 100, HEIGHT + 2), (10, -60), (4, HEIGHT)]
SIZES = (8, 24, 40)


def kept(layout, seed=0):
    levels = np.random.default_rng(seed).integers(0, 256, layout.frame_bytes, dtype=np.uint8)
    return KeptFrame(layout, levels, VideoReformatter())


def crop(image, x, y, size):
    """A square of an image, black outside of it."""
    padded = np.zeros((size, size, 3), np.uint8)
    for row, column in itertools.product(range(size), repeat=2):
        if 0 <= y + row < HEIGHT and 0 <= x + column < WIDTH:
            padded[row, column] = image[y + row, x + column]
    return padded


@pytest.mark.parametrize("colorspace", [1, 2, 5])
@pytest.mark.parametrize("color_range", [0, 1, 2])
@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuvj420p"])
def test_patches_are_parts_of_the_image(pixel_format, color_range, colorspace):
    frame = kept(Layout(pixel_format, WIDTH, HEIGHT, 0, colorspace, color_range))
    assert frame.in_patches
    for corners, size in itertools.product((INSIDE, ACROSS, BEYOND), SIZES):
        mosaic = frame.patches(corners, size)
        assert mosaic.shape == (size, len(corners) * size, 3)
        for k, (x, y) in enumerate(corners):
            np.testing.assert_array_equal(mosaic[:, k * size : (k + 1) * size], crop(frame.image, x, y, size))


@pytest.mark.parametrize("layout", [Layout("bgr24", 20, 12), Layout("yuv420p", 24, 12, rotation=1)])
def test_frames_that_are_turned_or_no_yuv_have_none(layout):
    frame = kept(layout)
    assert not frame.in_patches
    assert frame.shape == frame.image.shape == layout.image_shape


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    folder = tmp_path_factory.mktemp("store")
    render_recording(0, folder / "video.mp4", folder / "truth.csv", RenderVideoJob(duration_s=0.25))
    extract_frames(folder / "video.mp4", folder / "frames.b2frame", ExtractFramesJob())
    return FrameStore(folder / "frames.b2frame")


def test_kept_frames_are_tracked_as_their_images_are(store, monkeypatch):
    settings, images = TrackMarkersJob(), list(store)
    geometry, _ = estimate_geometry(images, settings)
    whole = track_frames(images, geometry, settings)
    made, image = [], Layout.image
    monkeypatch.setattr(Layout, "image", lambda *given: made.append(1) or image(*given))
    patched = track_frames(store.kept(), geometry, settings)
    assert 0 < len(made) < len(images) / 4  # where nothing was expected yet, all of it is searched
    assert patched.reason == whole.reason
    # Interpolation counts in 1/32 px, to which places in a small picture are rounded otherwise.
    assert np.abs(patched.position - whole.position).max() < 0.05
    assert np.median(np.abs(patched.position - whole.position)) < 1e-3
