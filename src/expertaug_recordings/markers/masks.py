"""Parts of the image in which no marker is looked for: hands, a text, another pendulum."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from expertaug_recordings.video.frame_store import FrameStore
from expertaug_recordings.video.kept_frame import KeptFrame

Polygon = Sequence[tuple[float, float]]
FRACTION = 4  # bits of a px to which corners are drawn


class MaskedFrames:
    """The frames of a store, black where nothing is to be seen.

    Arguments:
        frames: the store.
        masks: polygons by their corners (x, y) in px; two are opposite corners of a rectangle.
    """

    def __init__(self, frames: FrameStore, masks: Sequence[Polygon]) -> None:
        self._frames = frames
        self.t = frames.t
        self._polygons = [_corners(mask) for mask in masks]

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, index: int) -> np.ndarray:
        return self._hide(self._frames[index])

    def __iter__(self) -> Iterator[np.ndarray | KeptFrame]:
        return map(self._hide, self._frames) if self._polygons else self._frames.kept()

    def _hide(self, image: np.ndarray) -> np.ndarray:
        """Of an image in memory of its own."""
        if self._polygons:
            cv2.fillPoly(image, self._polygons, (0, 0, 0), cv2.LINE_8, FRACTION)
        return image


def _corners(mask: Polygon) -> np.ndarray:
    """Corners (k, 2) as OpenCV takes them."""
    points = np.array(mask, float)
    if len(points) == 2:
        (left, top), (right, bottom) = points
        points = np.array([(left, top), (right, top), (right, bottom), (left, bottom)])
    return np.rint(points * 2**FRACTION).astype(np.int32)
