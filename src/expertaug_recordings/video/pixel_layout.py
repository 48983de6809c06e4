"""How a decoded frame is kept and shown: the decoder's own planes where they are common, and BGR made of them.

A frame of 8-bit YUV with halved colour has half the bytes of its BGR image.  Kept as it is, it costs half as much to
pack, and the image that is made of it later is the same to the bit.

BGR is made only where somebody looks: making it of a frame of 480×480 px takes a third of its tracking; the markers
cover a twentieth of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import av
import cv2
import numpy as np
from av.video.reformatter import VideoReformatter

KEPT = ("yuv420p", "yuvj420p")  # any other format is kept as BGR, and so are images of odd sizes
MULTIPLE = 8  # px: sides of patches are multiples of it, as the conversion takes them
BLACK = {"yuv420p": (16, 128, 128), "yuvj420p": (0, 128, 128)}
FULL_RANGE = 2  # FFmpeg's number


@dataclass(frozen=True)
class Layout:
    """What the bytes of a kept frame mean.

    Attributes:
        pixel_format: FFmpeg's name: one of ``KEPT``, or bgr24.
        width, height: in px, as the decoder gives them.
        rotation: quarter turns counterclockwise from there to an upright image.
        colorspace, color_range: FFmpeg's numbers for how YUV becomes BGR.
        mirrored: whether left and right are exchanged before it is turned.
        aspect: width of a pixel of the decoder over its height; images have square ones, made by stretching the side
            that has fewer.
    """

    pixel_format: str
    width: int
    height: int
    rotation: int = 0
    colorspace: int = 2  # unspecified
    color_range: int = 0  # unspecified
    mirrored: bool = False
    aspect: float = 1.0

    @classmethod
    def of(cls, frame: av.VideoFrame, turns: int = 0, mirrored: bool = False, aspect: float = 1.0) -> Layout:
        """That in which a decoder's frame is kept, which becomes an image by these."""
        fits = frame.width % 2 == 0 and frame.height % 4 == 0  # else PyAV cannot take the planes back
        name = frame.format.name if frame.format.name in KEPT and fits else "bgr24"
        colours = int(frame.colorspace), int(frame.color_range)
        return cls(name, frame.width, frame.height, turns, *colours, mirrored, aspect)

    @property
    def frame_bytes(self) -> int:
        return self.width * self.height * 3 // (2 if self.pixel_format in KEPT else 1)

    @property
    def image_shape(self) -> tuple[int, int, int]:
        """(height, width, 3) of the upright image."""
        width, height = self._square_size
        return (width, height, 3) if self.rotation % 2 else (height, width, 3)

    @property
    def as_decoded(self) -> bool:
        """Whether the upright image has the decoder's pixels where they are."""
        return not self.rotation and not self.mirrored and self._square_size == (self.width, self.height)

    @property
    def _square_size(self) -> tuple[int, int]:
        """Width and height in square pixels."""
        return round(self.width * max(1.0, self.aspect)), round(self.height / min(1.0, self.aspect))

    def pack(self, frame: av.VideoFrame | np.ndarray, out: np.ndarray) -> None:
        """Put a frame, of the decoder or an image uint8 (height, width, 3), into bytes (frame_bytes,).

        Raises:
            ValueError: an image of another shape or type, or one for a layout of YUV.
        """
        if isinstance(frame, np.ndarray):
            if self.pixel_format != "bgr24":
                raise ValueError(f"an image for a layout of {self.pixel_format}; a decoder's frame expected")
            shape = (self.height, self.width, 3)
            if frame.shape != shape or frame.dtype != np.uint8:
                raise ValueError(f"frame is {frame.shape} {frame.dtype}, expected an image {shape} uint8")
            out.reshape(shape)[:] = frame
        elif self.pixel_format == "bgr24":
            out.reshape(self.height, self.width, 3)[:] = _bgr(frame)
        else:
            start = 0
            for plane in frame.planes:
                target = out[start : start + plane.width * plane.height].reshape(plane.height, plane.width)
                target[:] = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)[: plane.height, : plane.width]
                start += target.size

    def image(self, packed: np.ndarray) -> np.ndarray:
        """Upright image, uint8 BGR (height, width, 3), of bytes (frame_bytes,), in memory of its own."""
        if self.pixel_format == "bgr24":
            return self._upright(packed.reshape(self.height, self.width, 3).copy())
        planes = packed.reshape(self.height * 3 // 2, self.width)
        frame = av.VideoFrame.from_numpy_buffer(planes, format=self.pixel_format)
        frame.colorspace, frame.color_range = self.colorspace, self.color_range
        return self.image_of(frame)

    def image_of(self, frame: av.VideoFrame) -> np.ndarray:
        """Upright image, uint8 BGR (height, width, 3), of a decoder's frame."""
        return self._upright(_bgr(frame))

    def _upright(self, image: np.ndarray) -> np.ndarray:
        if self.as_decoded:
            return image
        if self._square_size != image.shape[1::-1]:
            image = cv2.resize(image, self._square_size, interpolation=cv2.INTER_CUBIC)
        return np.ascontiguousarray(np.rot90(image[:, ::-1] if self.mirrored else image, self.rotation))


def _bgr(frame: av.VideoFrame) -> np.ndarray:
    return frame.to_ndarray(format="bgr24", interpolation="BICUBIC", threads=1)


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
        return self._layout.pixel_format in KEPT and self._layout.as_decoded

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
