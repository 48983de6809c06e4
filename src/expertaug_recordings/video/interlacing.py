"""Whether a video's frames are woven of two fields, each of every other row and half a frame apart in time.

What moves then has teeth: rows that differ from both neighbours in the same direction, while every second row goes on
smoothly.  Codecs can say so, but some say it of frames whose fields are of one time.
"""

from __future__ import annotations

import shlex
from pathlib import Path

import av
import cv2
import numpy as np

from expertaug.errors import InputError

PAIRS = 24  # of frames that are compared, spread over a video
LEVEL = 14  # grey levels by which what moves and its teeth differ from what is around
MIN_MOVING = 50  # px
TEETH = 0.05  # of the px that move, in an image that has teeth
RATIO, FEW = 4.0, 5  # teeth to what is as rough between every second row, besides so many px
MIN_COMBED, COMBED = 3, 0.2  # images with teeth, and their share of those with motion: two of five after a telecine


class Fields:
    """Looks for teeth in a video's frames.

    Arguments:
        path: of the video, for messages.
        count: frames that it has.
    """

    def __init__(self, path: Path, count: int) -> None:
        self._path = path
        self._every = max(2, count // PAIRS)
        self._before: np.ndarray | None = None
        self._flagged = False
        self._moving = self._combed = 0

    def look(self, index: int, picture: av.VideoFrame) -> None:
        """Take the next frame of the decoder."""
        self._flagged |= bool(picture.interlaced_frame)
        place = index % self._every
        if place > 1:
            return
        grey = picture.to_ndarray(format="gray", threads=1)
        if place == 1 and self._before is not None and self._before.shape == grey.shape:
            moving, teeth, rough = combs(self._before, grey)
            if moving >= MIN_MOVING:
                self._moving += 1
                self._combed += teeth > TEETH * moving and teeth > RATIO * (rough + FEW)
        self._before = grey

    def refuse(self) -> None:
        """After the last frame.

        Raises:
            InputError: the frames are woven of fields, or a codec says so and too little moves to tell.
        """
        combed = self._combed >= MIN_COMBED and self._combed >= COMBED * self._moving
        if not combed and not (self._flagged and self._moving < MIN_COMBED):
            return
        seen = f"teeth in {self._combed} of {self._moving} frames" if combed else "its codec says so"
        raise InputError(
            self._path,
            f"is interlaced ({seen}): every other row was taken half a frame later",
            f"make each field a frame: ffmpeg -i {shlex.quote(self._path.name)} -vf bwdif -crf 12 out.mp4",
        )


def combs(before: np.ndarray, grey: np.ndarray) -> tuple[int, int, int]:
    """How many px of an image uint8 (height, width) moved since the one before, how many of them are teeth between
    neighbouring rows, and how many are so between every second row."""
    moved = cv2.compare(cv2.absdiff(before, grey), LEVEL, cv2.CMP_GT)
    return cv2.countNonZero(moved), _teeth(grey, moved, 1), _teeth(grey, moved, 2)


def _teeth(grey: np.ndarray, moved: np.ndarray, rows: int) -> int:
    """Px that moved and are lighter, or darker, than both those so many rows above and below."""
    above, here, below = grey[: -2 * rows], grey[rows:-rows], grey[2 * rows :]
    lighter = cv2.min(cv2.subtract(here, above), cv2.subtract(here, below))
    darker = cv2.min(cv2.subtract(above, here), cv2.subtract(below, here))
    sharp = cv2.compare(cv2.max(lighter, darker), LEVEL, cv2.CMP_GT)
    return cv2.countNonZero(cv2.bitwise_and(sharp, moved[rows:-rows]))
