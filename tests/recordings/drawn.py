"""Clips of pendulums in other looks than the renderer's: any size, colours, style, background and tilt."""

from __future__ import annotations

from fractions import Fraction

import av
import cv2
import numpy as np
from pendulum_motion import CONSTANTS, FRICTION

from expertaug_recordings.rendering.motion import simulate

SPARE = 32
FINE = 8  # drawn so many times larger, then averaged
WHITE = (235, 235, 235)
PAINT = {  # B, G, R
    "red": (40, 40, 210),
    "orange": (30, 120, 235),
    "yellow": (40, 200, 230),
    "green": (60, 170, 50),
    "cyan": (200, 190, 40),
    "blue": (200, 80, 40),
    "purple": (180, 50, 110),
    "magenta": (170, 40, 200),
}
ARMS, PIVOT, SIZE, RATE = (90.0, 60.0), (390.3, 165.6), (640, 360), 240.0


def swinging(count, launch=(2.2, 1.0, -6.0, -12.0)):
    """States (count, 4) at RATE."""
    return simulate(np.array([launch]), np.arange(count) / RATE, CONSTANTS, FRICTION)[0]


def wall():
    """A wall that is dark on one side of the pendulum, light on the other, and uneven."""
    image = np.full((SIZE[1], SIZE[0], 3), (205, 208, 212), np.uint8)
    image[:, : SIZE[0] * 45 // 100] = (62, 60, 58)
    return np.clip(image + np.random.default_rng(1).normal(0, 3, image.shape), 0, 255).astype(np.uint8)


def markers_of(theta, pivot, arms, tilt_deg=0.0):
    """Positions (n, 3, 2) in px of angles (n, 2) in rad from gravity, ``tilt_deg`` off the image's down."""
    at = theta + np.deg2rad(tilt_deg)
    step = np.stack([np.sin(at), np.cos(at)], axis=-1) * np.asarray(arms)[:, None]
    joint = np.asarray(pivot) + step[:, 0]
    return np.stack([np.broadcast_to(pivot, joint.shape), joint, joint + step[:, 1]], axis=1)


def draw(
    centres, size, colours, diameter=24.0, style="disk", background=(30, 30, 30), noise=3.0, seed=0, mark="", light=0.0
):
    """Frames (n, H, W, 3) of markers at (n, 3, 2) px; a colour (B, G, R) of None leaves its marker out.

    ``background`` is a colour or an image (H, W, 3); ``mark`` (of MARKS) is what the disks have burnt in, or one
    for each, and ``light`` the share by which they are brighter on the image's right and darker on its left.
    """
    width, height = size
    marks = (mark,) * len(colours) if isinstance(mark, str) else mark
    rng = np.random.default_rng(seed)
    empty = np.zeros((height, width, 3), np.uint8)
    empty[:] = background
    grain = np.rint(rng.normal(0, noise, (height + SPARE, width + SPARE, 3))).astype(np.int16)  # shifted every frame
    frames = np.empty((len(centres), height, width, 3), np.uint8)
    for frame, points in zip(frames, centres, strict=True):
        frame[:] = empty
        cv2.polylines(frame, [np.rint(points * 16).astype(np.int32)], False, (120, 120, 120), 3, cv2.LINE_AA, 4)
        lean = np.arctan2(*(points[1:] - points[:-1])[[0, 0, 1]].T)
        for k, colour in enumerate(colours):
            if colour is not None:
                _disk(frame, points[k], diameter / 2, colour, style, lean[k], marks[k], light)
        y, x = rng.integers(SPARE, size=2)
        frame[:] = np.clip(frame + grain[y : y + height, x : x + width], 0, 255)
    return frames


def _letter(a, b, r):
    """An F that fills a third of the disk's width."""
    stem = (np.abs(a + 0.25 * r) < 0.1 * r) & (np.abs(b) < 0.5 * r)
    return stem | ((np.abs(a) < 0.3 * r) & ((np.abs(b + 0.4 * r) < 0.1 * r) | (np.abs(b) < 0.1 * r)))


# Where a mark is, of a place along (b) and across (a) the arm and the disk's radius, and its colour.
MARKS = {
    "ring": (lambda a, b, r: np.abs(np.hypot(a, b) - 0.5 * r) < 0.1 * r, (20, 20, 20)),
    "dot": (lambda a, b, r: np.hypot(a, b) < 0.35 * r, (240, 240, 240)),
    "line": (lambda a, b, r: np.abs(a) < 0.12 * r, (20, 20, 20)),
    "screw": (lambda a, b, r: np.hypot(a, b) < 0.4 * r, (150, 155, 160)),
    "text": (_letter, (20, 20, 20)),
}


def _disk(frame, centre, radius, colour, style, lean, mark="", light=0.0):
    half = int(radius) + 3
    x0, y0 = np.rint(centre).astype(int) - half
    side = 2 * half + 1
    axis = (np.arange(side * FINE) + 0.5) / FINE - 0.5
    u, v = np.meshgrid(axis + x0 - centre[0], axis + y0 - centre[1], sparse=True)
    cover = (u * u + v * v < radius * radius).astype(np.float32)
    if style == "quadrant" or mark or light:
        paint = np.empty((*cover.shape, 3), np.float32)
        paint[:] = colour
        a, b = u * np.cos(lean) - v * np.sin(lean), u * np.sin(lean) + v * np.cos(lean)
        if style == "quadrant":
            paint[a * b > 0] = WHITE
        if mark:
            inside, ink = MARKS[mark]
            paint[inside(a, b, radius)] = ink
        paint = np.clip(paint * (1 + light * u / radius)[..., None], 0, 255)
        paint = cv2.resize(paint * cover[..., None], (side, side), interpolation=cv2.INTER_AREA)
        cover = cv2.resize(cover, (side, side), interpolation=cv2.INTER_AREA)
    else:
        cover = cv2.resize(cover, (side, side), interpolation=cv2.INTER_AREA)
        paint = cover[..., None] * np.array(colour, np.float32)
    low, high = max(0, -y0), min(side, frame.shape[0] - y0)
    left, right = max(0, -x0), min(side, frame.shape[1] - x0)
    if high <= low or right <= left:
        return
    view = frame[y0 + low : y0 + high, x0 + left : x0 + right]
    part = (slice(low, high), slice(left, right))
    view[:] = np.rint(view * (1 - cover[part])[..., None] + paint[part])


def write_video(frames, path, rate, crf=20):
    """Write frames as H.264, their colours at half the resolution where decoders expect them."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(rate), options={"crf": str(crf), "preset": "superfast"})
        stream.height, stream.width, stream.pix_fmt = *frames.shape[1:3], "yuv420p"
        stream.codec_context.thread_count = 1
        for frame in frames:
            image = av.VideoFrame.from_ndarray(frame, format="bgr24").reformat(format="yuv420p")
            for packet in stream.encode(image):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


def compressed(frames, path, rate, crf=20):
    """The frames as an H.264 file gives them back."""
    video = cv2.VideoCapture(str(write_video(frames, path, rate, crf)))
    return np.stack([video.read()[1] for _ in frames])
