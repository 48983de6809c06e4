"""The frames of one recording in one lossless, seekable file.

Frames are kept as the decoder gives them (:mod:`.pixel_layout`).  They are mostly black, so that the
fastest compressor (LZ4) keeps a frame in some 18 kB of its 346 kB and costs less than decoding it did.  The file is a
Blosc2 frame: chunks of some frames, each in blocks that fit a cache and are unpacked singly, and a dictionary beside
them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

import av
import blosc2
import numpy as np
from av.video.reformatter import VideoReformatter

from expertaug.errors import InputError
from expertaug.files import atomic, memory_limit
from expertaug_recordings.settings import ExtractFramesJob
from expertaug_recordings.video.pixel_layout import KeptFrame, Layout
from expertaug_recordings.video.source import open_frames

FORMAT = "expertaug frames 2"
CHUNK_BYTES = 16 * 480 * 480 * 3  # memory that writing needs, and what a sequential reader unpacks at once
BLOCK_BYTES = 2**17
UNPACKED = 4  # pieces that are in memory at once when a store is read


class FrameStore:
    """Read frames by number.

    Attributes:
        path: the file's path.
        shape: (n, height, width, 3) of the images, uint8 BGR.
        layout: how the kept frames' bytes are laid out.
        rate_hz: stored frames per second; of uneven times the nominal one.
        t: times of the frames in s from the first, (n,) float64: those of the source, or even ones.
        source: what the frames were taken from: file name, its frame rate and where that is known from.
    """

    def __init__(self, path: str | Path) -> None:
        """Open a store.

        Raises:
            InputError: the file is missing or was not written by this class.
        """
        self.path = Path(path)
        if not self.path.is_file():
            raise InputError(path, "no such file", "run extract_frames")
        try:
            self._chunks = blosc2.open(str(path), mode="r", dparams={"nthreads": 1})
            meta = dict(self._chunks.vlmeta.getall())
        except (RuntimeError, ValueError, OSError, AttributeError) as error:
            raise InputError(path, f"not a frame store ({type(error).__name__})", "run extract_frames again") from error
        if meta.get("format") != FORMAT:
            raise InputError(path, "not a frame store of this version", "run extract_frames again")
        try:
            self.layout = Layout(**meta["layout"])
            self.shape = (int(meta["count"]), *self.layout.image_shape)
            self.rate_hz = float(meta["rate_hz"])
            self.source = dict(meta["source"])
            self._times = None if meta.get("times") is None else np.frombuffer(meta["times"], np.float64)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(path, f"not a frame store ({error!r})", "run extract_frames again") from error
        largest = max(self.layout.frame_bytes, self._chunks.chunksize)
        if UNPACKED * largest > memory_limit():  # zeros of any size fit into a few bytes
            problem = f"a piece takes {largest / 1e9:.3g} GB, and there is memory for {memory_limit() / 1e9:.3g}"
            raise InputError(path, problem, "run extract_frames again")
        if self._chunks.nbytes != self.shape[0] * self.layout.frame_bytes:
            raise InputError(
                path, f"holds {self._chunks.nbytes} bytes for {self.shape[0]} frames", "run extract_frames again"
            )

    def __len__(self) -> int:
        return self.shape[0]

    @property
    def t(self) -> np.ndarray:
        return np.arange(len(self)) / self.rate_hz if self._times is None else self._times

    def __getitem__(self, index: int) -> np.ndarray:
        """One frame, (height, width, 3); a negative index counts from the end."""
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        index %= len(self)
        return self.read(index, index + 1)[0]

    def read(self, start: int, stop: int) -> np.ndarray:
        """Frames ``start`` to ``stop`` (not included), (k, height, width, 3); both are cut to the store."""
        start, stop = max(0, start), min(stop, len(self))
        if stop <= start:
            return np.empty((0, *self.shape[1:]), np.uint8)
        out = np.empty((stop - start, *self.shape[1:]), np.uint8)
        packed = np.empty((stop - start, self.layout.frame_bytes), np.uint8)
        self._unpack(start, stop, packed)
        for image, frame in zip(out, packed, strict=True):
            image[:] = self.layout.image(frame)
        return out

    def _unpack(self, start: int, stop: int, out: np.ndarray) -> None:
        """Put the bytes of kept frames into (stop - start, frame_bytes)."""
        size = self.layout.frame_bytes
        try:
            self._chunks.get_slice(start * size, stop * size, out)
        except (RuntimeError, ValueError) as error:
            raise InputError(
                self.path, f"frames {start} to {stop} cannot be read", "run extract_frames again"
            ) from error

    def __iter__(self) -> Iterator[np.ndarray]:
        for frame in self.kept():
            yield frame.image

    def kept(self) -> Iterator[KeptFrame]:
        """All frames as they are kept, each to be looked at before the next is taken."""
        reformatter = VideoReformatter()
        # One buffer for all chunks: new ones would leave memory in pieces, the more the longer the video.
        buffer = np.empty((_frames_per_chunk(self.layout), self.layout.frame_bytes), np.uint8)
        for start in range(0, len(self), len(buffer)):
            chunk = buffer[: min(len(buffer), len(self) - start)]
            self._unpack(start, start + len(chunk), chunk)
            for packed in chunk:
                yield KeptFrame(self.layout, packed, reformatter)


def _frames_per_chunk(layout: Layout) -> int:
    return max(1, CHUNK_BYTES // layout.frame_bytes)


class FrameWriter:
    """Appends frames to a new store; made by :func:`writing`.

    Attributes:
        count: frames that were appended.
        times, rate_hz: to be set where the frames turn out to be uneven: their times in s, (n,), and nominal rate.
    """

    def __init__(self, path: Path, layout: Layout) -> None:
        self.times: np.ndarray | None = None
        self.rate_hz: float | None = None
        self._layout = layout
        self._buffer = np.empty((_frames_per_chunk(layout), layout.frame_bytes), np.uint8)
        self._filled = 0
        self.count = 0
        self._chunks = blosc2.SChunk(
            chunksize=self._buffer.nbytes,
            urlpath=str(path),
            contiguous=True,
            mode="w",
            cparams={
                "codec": blosc2.Codec.LZ4,
                "clevel": 1,
                "filters": [blosc2.Filter.NOFILTER],
                "typesize": 1,
                "blocksize": min(BLOCK_BYTES, self._buffer.nbytes),
                "nthreads": 1,
            },
        )

    def append(self, frame: av.VideoFrame | np.ndarray) -> None:
        """Append one frame, of the decoder or an image; see :meth:`Layout.pack`."""
        self._layout.pack(frame, self._buffer[self._filled])
        self._filled += 1
        self.count += 1
        if self._filled == len(self._buffer):
            self._flush()

    def _flush(self) -> None:
        if self._filled:
            self._chunks.append_data(self._buffer[: self._filled])
            self._filled = 0

    def finish(self, rate_hz: float, source: Mapping, times: np.ndarray | None) -> None:
        self._flush()
        meta = {
            "format": FORMAT,
            "count": self.count,
            "layout": asdict(self._layout),
            "rate_hz": rate_hz,
            "source": dict(source),
            "times": None if times is None else times.astype(np.float64).tobytes(),
        }
        for key, value in meta.items():
            self._chunks.vlmeta[key] = value


@contextmanager
def writing(path: str | Path, layout: Layout, rate_hz: float, source: Mapping) -> Iterator[FrameWriter]:
    """Write a new frame store, which appears at ``path`` only when the block ends well.

    Arguments:
        layout: how the frames' bytes are laid out.
        rate_hz: stored frames per second.
        source: plain values that describe where the frames come from.

    Raises:
        InputError: the folder is read-only or the disk is full.
    """
    with atomic(path) as temporary:
        try:
            writer = FrameWriter(temporary, layout)
            yield writer
            writer.finish(writer.rate_hz or rate_hz, source, writer.times)
            FrameStore(temporary)
        except RuntimeError as error:
            raise InputError(
                path, f"cannot be written ({error})", "free some space or choose another results folder"
            ) from error


def run_stage(video: Path, store: Path, job: ExtractFramesJob) -> None:
    """Stage: decode a video into a frame store at the analysis rate; memory does not grow with the length.

    Arguments:
        video: a file as :class:`~expertaug_recordings.video.reader.Video` takes, or a folder of pictures
            (:class:`~expertaug_recordings.video.source.Pictures`).
        store: file to write.  It has every n-th frame, as many as the analysis rate takes; where that does not divide
            the rate, and where times are uneven, the angles are resampled later.
        job: its settings.

    Raises:
        InputError: the video or a setting cannot be used, or the store cannot be written.
    """
    with open_frames(video, job, job.expected_frames, job.image_size_px) as source:
        step = frames_apart(source.rate_hz, job.analysis_rate_hz)
        described = {
            "video": Path(video).name,
            "rate_hz": source.rate_hz,
            "rate_provenance": source.rate_provenance,
            "frames": source.count,
            "step": step,
        }
        with writing(store, source.layout, source.rate_hz / step, described) as out:
            for _, picture in source.pictures(step):
                out.append(picture)
            if source.times is not None:
                out.times, out.rate_hz = source.times[::step], source.rate_hz / step
            refuse_slow(source.rate_hz, source.times is not None, job.analysis_rate_hz, source.path)


def frames_apart(rate_hz: float, analysis_rate_hz: float | None) -> int:
    """Every how many frames of a video one is kept, for at least as many a second as the analysis asks for."""
    return 1 if analysis_rate_hz is None else max(1, math.floor(rate_hz / analysis_rate_hz + 1e-3))


def refuse_slow(rate_hz: float, uneven: bool, analysis_rate_hz: float | None, where: object = "video") -> None:
    """Frames between those that were taken cannot be made.

    Arguments:
        rate_hz: of the video, of uneven times the nominal one.
        where: what messages call it.

    Raises:
        InputError: the analysis asks for more frames a second.
    """
    slack = 0.05 if uneven else 1e-3
    if analysis_rate_hz is not None and rate_hz < (1 - slack) * analysis_rate_hz:
        raise InputError(
            where,
            f"the analysis rate of {analysis_rate_hz:g} Hz is above the frame rate of {rate_hz:g} Hz",
            f"set recordings.analysis_rate_hz to {rate_hz:g} or less",
        )
