"""Reading a video with OpenCV without trusting it.

OpenCV never raises: a broken file does not open, ends early or gives spoiled frames without a word in Python.  Here
everything that can be told is checked, and what the decoder complains about on standard error is read, not shown.
"""

from __future__ import annotations

import math
import os
import re
import tempfile
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from expertaug.errors import InputError

RATES_HZ = (1.0, 20_000.0)  # outside, a declared frame rate is taken for a missing one
MIN_SIDE_PX, MAX_PX = 16, 2**25  # of an image: 8K video has 2^24.98 px, a forged header millions of millions
ROUNDING_MS = 0.5  # where timestamps are whole milliseconds, as in Matroska
# Playlists, picture sequences and the like are not read: they name other files.
CONTAINERS = "mov,matroska,avi,mpegts,mpeg,mpegvideo,m4v,h264,hevc,ivf,asf,flv,ogg,nut,mxf,yuv4mpegpipe"


class Video:
    """An opened video whose metadata have been checked; :meth:`frames` reads it once and checks the rest.

    Attributes:
        path: of the file.
        count: frames that it must have.
        rate_hz: frames per second, and ``rate_provenance`` where that number comes from.
        width, height: in px.
    """

    def __init__(
        self,
        path: str | Path,
        rate_hz: float | None = None,
        rate_provenance: str | None = None,
        expected_frames: int | None = None,
        image_size_px: int | tuple[int, int] | None = None,
    ) -> None:
        """Open and check.

        Arguments:
            path: any file that OpenCV's FFmpeg reads.
            rate_hz: frame rate at which the video was taken; None takes the file's own.
            rate_provenance: where ``rate_hz`` is known from, in words.
            expected_frames: number of frames; None takes the file's own.
            image_size_px: side of a square image or (width, height); None takes what comes.

        Raises:
            InputError: the file is missing, empty or no video, or its metadata are missing or not as expected.
        """
        self.path = Path(path)
        if not self.path.is_file():
            raise InputError(path, "no such file", "give a video file")
        if self.path.stat().st_size == 0:
            raise InputError(path, "is empty (0 bytes)", "copy the recording again")
        self._log = _DecoderLog()
        with self._log.reading(), _containers_only():
            # An absolute path cannot be taken for an address.
            self._capture = cv2.VideoCapture(str(self.path.absolute()), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
        if not self._capture.isOpened():
            self.close()
            raise InputError(
                path, "cannot be opened as a video", "it is truncated or not a video: copy the recording again"
            )
        try:
            self._check_metadata(rate_hz, rate_provenance, expected_frames, image_size_px)
        except InputError:
            self.close()
            raise

    def _check_metadata(self, rate_hz, rate_provenance, expected_frames, image_size_px) -> None:
        declared_rate = self._capture.get(cv2.CAP_PROP_FPS)
        declared_count = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        self.width = int(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH))
        self.height = int(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        if min(self.width, self.height) < MIN_SIDE_PX or self.width * self.height > MAX_PX:
            raise InputError(
                self.path,
                f"declares images of {self.width}x{self.height} px",
                f"they must have at least {MIN_SIDE_PX} px a side and at most {MAX_PX >> 20} million px",
            )
        # A bare stream has neither a count nor a rate; the rate that FFmpeg then reports is its own guess.
        counted = math.isfinite(declared_count) and 0 < declared_count < 2**40
        self._declared_rate = declared_rate if counted and RATES_HZ[0] <= declared_rate <= RATES_HZ[1] else None
        if image_size_px is not None:
            width, height = (image_size_px, image_size_px) if isinstance(image_size_px, int) else image_size_px
            if (self.width, self.height) != (width, height):
                raise InputError(
                    self.path, f"images are {self.width}x{self.height} px", f"{width}x{height} expected (image_size_px)"
                )
        if rate_hz is None and self._declared_rate is None:
            found = f"{declared_rate:g} Hz" if counted else "none"
            raise InputError(
                self.path, f"no usable frame rate in its metadata ({found})", "set recordings.videos.rate_hz"
            )
        self.rate_hz = float(rate_hz if rate_hz is not None else self._declared_rate)
        if not RATES_HZ[0] <= self.rate_hz <= RATES_HZ[1]:
            raise InputError(
                "recordings.videos.rate_hz", f"is {self.rate_hz:g} Hz", f"give {RATES_HZ[0]:g} to {RATES_HZ[1]:g}"
            )
        self.rate_provenance = (rate_provenance or "configured") if rate_hz is not None else "video metadata"
        if expected_frames is None and not counted:
            raise InputError(self.path, "no frame count in its metadata", "convert it to mp4, which keeps it")
        self.count = int(expected_frames if expected_frames is not None else declared_count)
        if expected_frames is not None and counted and int(declared_count) != expected_frames:
            raise InputError(
                self.path, f"declares {int(declared_count)} frames", f"{expected_frames} expected (expected_frames)"
            )

    def frames(self, step: int = 1, out: object = None) -> Iterator[tuple[int, np.ndarray]]:
        """Read every ``step``-th frame from the first on; the rest is decoded and checked, but not converted.

        Arguments:
            step: at least 1.
            out: called without arguments before each kept frame; the array (height, width, 3) to decode it into.

        Yields:
            Index from 0 and image, uint8 BGR (height, width, 3).

        Raises:
            InputError: the file ends early or late, changes its size, its timestamps are uneven or its decoder
                reported spoiled frames.
        """
        times = array("d")  # 8 bytes a frame: all that grows with the length
        while True:
            keep = len(times) % step == 0 and len(times) < self.count
            target = out() if keep and out is not None else None
            ok, ok_image, image = self._next(keep, target)
            if not ok:
                break
            index = len(times)
            times.append(self._capture.get(cv2.CAP_PROP_POS_MSEC))
            self._check_so_far(index)
            if keep:
                if not ok_image or image.shape != (self.height, self.width, 3):
                    raise InputError(self.path, f"frame {index} cannot be read", "copy the recording again")
                yield index, image
        self._check_end(np.frombuffer(times))

    def _next(self, keep: bool, target: np.ndarray | None) -> tuple[bool, bool, np.ndarray | None]:
        """Whether there is a next frame, whether it can be read, and its image if it is to be kept."""
        try:
            with self._log.reading():
                ok = self._capture.grab()
                return ok, *(self._capture.retrieve(target) if ok and keep else (ok, None))
        except (cv2.error, MemoryError):
            return True, False, None

    def _check_so_far(self, index: int) -> None:
        if index >= self.count:
            raise InputError(
                self.path,
                f"has more than the {self.count} frames declared",
                "convert it to mp4 anew, which counts them",
            )
        complaint = self._log.complaint()
        if complaint:
            raise InputError(
                self.path, f"spoiled near frame {index} (decoder: {complaint})", "copy the recording again"
            )

    def _check_end(self, times: np.ndarray) -> None:
        if len(times) != self.count:
            raise InputError(
                self.path,
                f"ends after {len(times)} of {self.count} declared frames",
                "copy the recording again, or convert what there is to mp4",
            )
        if len(times) < 3:
            return
        rounding = ROUNDING_MS if (times == np.round(times)).all() else 0.0
        number = np.arange(len(times)) - (len(times) - 1) / 2
        step = float(number @ times / (number @ number))  # of least squares: a missing frame is half a step off it
        if not step > 0:
            raise InputError(
                self.path, "its frames have no timestamps", "convert it to a container that keeps them, such as mp4"
            )
        uneven = float(np.abs(times - times.mean() - step * number).max())
        if uneven > 0.25 * step + rounding:
            jump = int(np.abs(np.diff(times) - step).argmax())
            raise InputError(
                self.path,
                f"variable frame rate: times are up to {uneven:.1f} ms off even steps of {step:.3f} ms; frame"
                f" {jump + 1} comes {times[jump + 1] - times[jump]:.3f} ms after the one before",
                "convert it to a constant frame rate, or copy the recording again if frames are missing",
            )
        if self.rate_provenance == "video metadata" and abs(step * self.rate_hz / 1000 - 1) > 0.01:
            raise InputError(
                self.path,
                f"declares {self.rate_hz:g} Hz but its timestamps step as {1000 / step:.4g} Hz",
                "set recordings.videos.rate_hz",
            )

    def close(self) -> None:
        self._capture.release()
        self._log.close()

    def __enter__(self) -> Video:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@contextmanager
def _containers_only() -> Iterator[None]:
    """Let OpenCV's FFmpeg, which takes its options from the environment, open files of known containers alone."""
    name = "OPENCV_FFMPEG_CAPTURE_OPTIONS"
    before = os.environ.get(name)
    os.environ[name] = f"protocol_whitelist;file|format_whitelist;{CONTAINERS}"
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


class _DecoderLog:
    """What native libraries write to standard error while OpenCV reads; FFmpeg tells of spoiled frames only there."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 - closed by close()
        self._read = 0

    @contextmanager
    def reading(self) -> Iterator[None]:
        saved = os.dup(2)
        os.dup2(self._file.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(saved, 2)
            os.close(saved)

    def complaint(self) -> str:
        """The first new line, or nothing: FFmpeg tells only errors, and each may have spoiled what it gives."""
        size = os.fstat(self._file.fileno()).st_size
        if size == self._read:
            return ""
        text = os.pread(self._file.fileno(), size - self._read, self._read).decode(errors="replace")
        self._read = size
        lines = [line for line in text.splitlines() if line.strip() and not line.startswith("[ ")]  # OpenCV's own
        return re.sub(r"^\[[^\]]*\]\s*", "", lines[0]).strip()[:100] if lines else ""

    def close(self) -> None:
        self._file.close()
