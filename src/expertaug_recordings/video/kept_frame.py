"""One frame as it is kept, of which BGR is made only where somebody looks.

To make BGR of a frame of 480×480 px takes as long as a third of its tracking; the markers cover a twentieth of it.
"""

from __future__ import annotations

from functools import cached_property

import av
import numpy as np
from av.video.reformatter import VideoReformatter

from expertaug_recordings.video.pixel_layout import KEPT, Layout

MULTIPLE = 8  # px: sides of patches are multiples of it, as the conversion takes them
BLACK = {"yuv420p": (16, 128, 128), "yuvj420p": (0, 128, 128)}
FULL_RANGE = 2  # FFmpeg's number


class KeptFrame:
    """A frame in the bytes of its store.

    Arguments:
        layout: what the bytes mean.
        packed: (frame_bytes,), which must not change while the frame is looked at.
        reformatter: of the one who goes through the frames; it keeps what a conversion needs for the next one.

    Attributes:
        shape: (height, width, 3) of its image.
    """

    def __init__(self, layout: Layout, packed: np.ndarray, reformatter: VideoReformatter) -> None:
        self.shape = layout.image_shape
        self._layout = layout
        self._packed = packed
        self._reformatter = reformatter

    @cached_property
    def image(self) -> np.ndarray:
        """All of it, uint8 BGR (height, width, 3)."""
        return self._layout.image(self._packed)

    @property
    def in_patches(self) -> bool:
        """Whether patches can be made without the image."""
        return self._layout.pixel_format in KEPT and not self._layout.rotation

    def patches(self, corners: list[tuple[int, int]], size: int) -> np.ndarray:
        """Squares of the image side by side, uint8 BGR (size, m * size, 3), as they are in it to the bit.

        Arguments:
            corners: x and y in px of each square's first pixel, even numbers; what is outside of the image is black.
            size: of a square, a multiple of ``MULTIPLE``.
        """
        layout = self._layout
        width, height, count = layout.width, layout.height, len(corners)
        mosaic = np.empty((size * 3 // 2, count * size), np.uint8)
        whole, drawn, black = self._packed, mosaic.reshape(-1), BLACK[layout.pixel_format]
        if layout.color_range == FULL_RANGE:
            black = BLACK["yuvj420p"]
        start = filled = 0
        for half, level in zip((1, 2, 2), black, strict=True):
            high, wide, side = height // half, width // half, size // half
            plane = whole[start : start + high * wide].reshape(high, wide)
            target = drawn[filled : filled + side * side * count].reshape(side, side * count)
            for k, (x, y) in enumerate(corners):
                _copy(plane, x // half, y // half, target[:, k * side : (k + 1) * side], level)
            start, filled = start + plane.size, filled + target.size
        frame = av.VideoFrame.from_numpy_buffer(mosaic, format=layout.pixel_format)
        frame.colorspace, frame.color_range = layout.colorspace, layout.color_range
        return self._reformatter.reformat(frame, format="bgr24", interpolation="BICUBIC", threads=1).to_ndarray()


def _copy(plane: np.ndarray, x: int, y: int, target: np.ndarray, outside: int) -> None:
    """The part of a plane that begins at x and y, as large as ``target``; ``outside`` where the plane has ended."""
    side = len(target)
    high, wide = plane.shape
    if 0 <= x <= wide - side and 0 <= y <= high - side:
        target[:] = plane[y : y + side, x : x + side]
        return
    target[:] = outside
    left, top = min(max(x, 0), wide), min(max(y, 0), high)
    part = plane[top : max(y + side, top), left : max(x + side, left)]
    target[top - y : top - y + len(part), left - x : left - x + part.shape[1]] = part
