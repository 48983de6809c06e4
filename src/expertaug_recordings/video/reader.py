"""Reading a video with FFmpeg (PyAV) without trusting it.

FFmpeg goes on where it can: a broken file ends early or gives spoiled frames, and says so in its log alone.  Here
everything that can be told is checked, and what the decoder complains about is read, not shown.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from expertaug.errors import InputError
from expertaug_recordings.video import declared, timestamps
from expertaug_recordings.video.interlacing import Fields
from expertaug_recordings.video.pixel_layout import Layout

RATES_HZ = (1.0, 20_000.0)  # outside, a declared frame rate is taken for a missing one
MIN_SIDE_PX, MAX_PX = 16, 2**25  # of an image: 8K video has 2^24.98 px, a forged header millions of millions
# Playlists, picture sequences and the like are not read: they name other files.
CONTAINERS = "mov,matroska,avi,mpegts,mpeg,mpegvideo,m4v,h264,hevc,ivf,asf,flv,ogg,nut,mxf,yuv4mpegpipe"
OPTIONS = {"protocol_whitelist": "file", "format_whitelist": CONTAINERS}

RATE_KEY = "set recordings.videos.rate_hz (of expertaug inspect-video --rate)"


class Video:
    """An opened video whose metadata have been checked; :meth:`pictures` or :meth:`frames` reads it once and checks the
    rest.

    Attributes:
        path: the file's path.
        count: frames that it must have, of those that are wanted (:meth:`trim`).
        rate_hz: frames per second, and ``rate_provenance`` where that number comes from; of a variable rate the nominal
            one (of the median interval), once all frames are read.
        times: of its frames in s from the first, (n,), once all are read; None where they are even.
        layout: how its frames are kept.
        width, height: size of its upright images in px.
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
            path: a video file that FFmpeg reads, of any of ``CONTAINERS``.
            rate_hz: frame rate at which the video was taken; None takes the file's own.
            rate_provenance: where ``rate_hz`` is known from, in words.
            expected_frames: number of frames; None takes the file's own.
            image_size_px: side of a square image or (width, height); None takes what comes.

        Raises:
            InputError: the file is missing, empty or no video, or its metadata are missing or not as expected.
        """
        self.path, self._wanted = Path(path), None
        self.times: np.ndarray | None = None
        if not self.path.is_file():
            raise InputError(path, "no such file", "give a video file")
        if self.path.stat().st_size == 0:
            raise InputError(path, "is empty (0 bytes)", "copy the recording again")
        self._complaints: list[str] = []
        try:
            with self._listening():
                # An absolute path cannot be taken for an address.
                self._container = av.open(str(self.path.absolute()), options=OPTIONS, metadata_errors="replace")
        except (av.FFmpegError, ValueError, MemoryError):
            self._container = None
        streams = self._container.streams.video if self._container is not None else ()
        if not streams or streams[0].codec_context is None:  # without a known codec
            self.close()
            raise InputError(path, *declared.no_video(self.path))
        try:
            stream = streams[0]
            stream.codec_context.thread_count = 1
            self._check_size(stream.codec_context.width, stream.codec_context.height)
            self._decoder = self._container.decode(stream)
            self._first = self._next()
            self._use_first(stream, image_size_px)
            self._check_metadata(stream, rate_hz, rate_provenance, expected_frames)
        except InputError:
            self.close()
            raise

    def _check_size(self, width: int, height: int) -> None:
        if min(width, height) < MIN_SIDE_PX or width * height > MAX_PX:
            raise InputError(
                self.path,
                f"declares images of {width}x{height} px",
                f"they must have at least {MIN_SIDE_PX} px a side and at most {MAX_PX >> 20} million px",
            )

    def _use_first(self, stream: av.VideoStream, image_size_px: int | tuple[int, int] | None) -> None:
        """Only a decoded frame tells how the images are turned; they are as players show them."""
        if self._first is not None:
            turned = declared.orientation(self.path, self._first)
            self.layout = Layout.of(self._first, *turned, declared.pixel_aspect(self.path, stream))
            self._shape = (self._first.width, self._first.height, self._first.format.name)
        else:
            self.layout = Layout("bgr24", stream.codec_context.width, stream.codec_context.height)
        self.height, self.width, _ = self.layout.image_shape
        self._check_size(self.width, self.height)
        if image_size_px is not None:
            width, height = (image_size_px, image_size_px) if isinstance(image_size_px, int) else image_size_px
            if (self.width, self.height) != (width, height):
                raise InputError(
                    self.path, f"images are {self.width}x{self.height} px", f"{width}x{height} expected (image_size_px)"
                )

    def _check_metadata(self, stream, rate_hz, rate_provenance, expected_frames) -> None:
        self._tick_ms = float(1000 * (stream.time_base or Fraction(1, 1000)))
        arguments = self.path, self._container, OPTIONS, self._tick_ms
        heard = len(self._complaints)
        with self._listening():
            declared_rate = declared.declared_rate(*arguments)
            count = declared.frame_count(*arguments, declared_rate)
        del self._complaints[heard:]  # what is spoiled is told where it is decoded
        # A bare stream has neither a count nor a rate; the rate that FFmpeg then reports is its own guess.
        counted = 0 < count < 2**40
        self._declared_rate = declared_rate if counted and RATES_HZ[0] <= declared_rate <= RATES_HZ[1] else None
        if rate_hz is None and self._declared_rate is None:
            rate_text = f"{declared_rate:g} Hz" if counted else "none"
            raise InputError(self.path, f"no usable frame rate in its metadata ({rate_text})", RATE_KEY)
        if rate_hz is None:
            declared.refuse_filmed_otherwise(*arguments, declared_rate)
        self.rate_hz = float(rate_hz if rate_hz is not None else self._declared_rate)
        if not RATES_HZ[0] <= self.rate_hz <= RATES_HZ[1]:
            raise InputError(
                "recordings.videos.rate_hz", f"is {self.rate_hz:g} Hz", f"give {RATES_HZ[0]:g} to {RATES_HZ[1]:g}"
            )
        self._is_configured = rate_hz is not None
        self.rate_provenance = (rate_provenance or "configured") if self._is_configured else "video metadata"
        if expected_frames is None and not counted:
            raise InputError(self.path, "no frame count in its metadata", "convert it to mp4, which keeps it")
        self.count = self._declared = int(expected_frames if expected_frames is not None else count)
        if expected_frames is not None and counted and count != expected_frames:
            raise InputError(self.path, f"declares {count} frames", f"{expected_frames} expected (expected_frames)")

    def trim(self, from_s: float, to_s: float | None) -> None:
        """Give only the frames that a player shows in a span of time in s (None: to the end), numbered from 0; what
        comes after them is neither read nor checked.

        Raises:
            InputError: there are hardly any.
        """
        heard = len(self._complaints)
        with self._listening():
            shown = timestamps.shown_ms(self.path, OPTIONS, self._tick_ms)
        del self._complaints[heard:]  # of all of the file
        times = np.arange(self._declared) / self.rate_hz if shown is None else shown / 1000
        self._wanted = timestamps.span(self.path, times, from_s, to_s)
        self.count = len(self._wanted)

    def frames(self, step: int = 1) -> Iterator[tuple[int, np.ndarray]]:
        """Images of :meth:`pictures`: index from 0 and upright image, uint8 BGR (height, width, 3)."""
        for index, picture in self.pictures(step):
            yield index, self.layout.image_of(picture)

    def pictures(self, step: int = 1) -> Iterator[tuple[int, av.VideoFrame]]:
        """Read every ``step``-th frame from the first on; the rest is decoded and checked as well.

        Arguments:
            step: at least 1.

        Yields:
            Index from 0 (the first that is wanted) and the decoder's frame, of :attr:`layout`.

        Raises:
            InputError: the file ends early or late, changes its size, has timestamps that run backwards or none, is
                interlaced, or its decoder reported spoiled frames.
        """
        times = array("d")  # 8 bytes a frame: all that grows with the length
        picture, self._first = self._first, None
        fields = Fields(self.path, self.count)
        first, stop = (0, math.inf) if self._wanted is None else (self._wanted.start, self._wanted.stop)
        while picture is not None:
            index = len(times)
            times.append(self._time_ms(picture, index))
            self._check_so_far(index, picture)
            if index >= first:
                fields.look(index - first, picture)
            if index >= first and (index - first) % step == 0:
                yield index - first, picture
            picture = self._next() if index + 1 < stop else None
        self._check_end(np.frombuffer(times), first, min(stop, self._declared))
        fields.refuse()

    def _next(self) -> av.VideoFrame | None:
        """The next frame; None at the end, and where decoding fails, which then is a complaint."""
        with self._listening():
            try:
                return next(self._decoder, None)
            except (av.FFmpegError, MemoryError) as error:
                self._complaints.append(str(error))
                return None

    def _time_ms(self, picture: av.VideoFrame, index: int) -> float:
        """When a frame is shown; without any timestamps, as in bare streams, frames are evenly spaced by assumption."""
        ticks = picture.pts if picture.pts is not None else picture.dts
        return ticks * self._tick_ms if ticks is not None else 1000 * index / self.rate_hz

    @contextmanager
    def _listening(self) -> Iterator[None]:
        """Keep what FFmpeg tells of errors, each of which may have spoiled what it gives."""
        level, skips = av.logging.get_level(), av.logging.get_skip_repeated()
        av.logging.set_level(av.logging.ERROR)
        av.logging.set_skip_repeated(False)  # another file's complaint may have been the same
        try:
            with av.logging.Capture() as lines:
                yield
        finally:
            av.logging.set_level(level)
            av.logging.set_skip_repeated(skips)
            self._complaints += [text for _, _, text in lines]

    def _check_so_far(self, index: int, picture: av.VideoFrame) -> None:
        if index >= self._declared:
            raise InputError(
                self.path,
                f"has more than the {self._declared} frames declared",
                "convert it to mp4 anew, which counts them",
            )
        if picture.is_corrupt:
            self._complaints.append("corrupt frame")
        self._check_heard(index)
        if (picture.width, picture.height, picture.format.name) != self._shape:
            raise InputError(
                self.path,
                f"frame {index} is {picture.width}x{picture.height} px {picture.format.name}, unlike those before",
                "copy the recording again",
            )

    def _check_heard(self, index: int) -> None:
        if heard := self._heard():
            raise InputError(self.path, f"spoiled near frame {index}{heard}", "copy the recording again")

    def _heard(self) -> str:
        """The first complaint, in brackets."""
        first = next((" ".join(text.split()) for text in self._complaints if text.strip()), "")
        return f" (decoder: {first[:100]})" if first else ""

    def _check_end(self, times: np.ndarray, first: int, stop: float) -> None:
        if len(times) != stop:
            raise InputError(
                self.path,
                f"ends after {len(times)} of {self._declared} declared frames{self._heard()}",
                "copy the recording again, or convert what there is to mp4",
            )
        self._check_heard(len(times) - 1)
        if len(times) - first > 2:
            self._judge_times(times[first:])

    def _judge_times(self, times: np.ndarray) -> None:
        """Even times are those of the rate; others are kept, in the time of the configured rate."""
        if not np.diff(times).any():
            remedy = "convert it to a container that keeps them, such as mp4"
            raise InputError(self.path, "its frames have no timestamps", remedy)
        step, even = timestamps.judge(self.path, times, self._tick_ms)
        if not even:
            self.rate_hz, self.times = timestamps.in_seconds(times, self.rate_hz if self._is_configured else None)
        elif not self._is_configured and abs(step * self.rate_hz / 1000 - 1) > 0.01:
            raise InputError(
                self.path,
                f"declares {self.rate_hz:g} Hz but its timestamps step as {1000 / step:.4g} Hz",
                RATE_KEY,
            )

    def close(self) -> None:
        if self._container is not None:
            self._container.close()

    def __enter__(self) -> Video:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
