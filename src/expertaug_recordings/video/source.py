"""Where frames come from: a video, or a series of pictures in a folder, which is read like one."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from expertaug.errors import InputError
from expertaug_recordings.names import FEWEST, PICTURES, list_pictures
from expertaug_recordings.settings import StatedTimes
from expertaug_recordings.video import timestamps
from expertaug_recordings.video.pixel_layout import Layout
from expertaug_recordings.video.reader import MAX_PX, MIN_SIDE_PX, RATES_HZ, Video

NAMES = "names"
NUMBER = re.compile(r"\d+(?:\.\d+)?")
COLUMNS = ["file", "t"]


class Pictures:
    """A folder of pictures of one size; the same attributes and methods as :class:`.reader.Video`."""

    def __init__(
        self,
        path: str | Path,
        rate_hz: float | None = None,
        rate_provenance: str | None = None,
        expected_frames: int | None = None,
        image_size_px: int | tuple[int, int] | None = None,
        times: str | None = None,
        time_unit_s: float = 1.0,
    ) -> None:
        """Open and check all but the pictures themselves.

        Arguments:
            path: a folder of PNG, JPEG, TIFF or BMP.
            rate_hz: pictures per second; not needed where times are given.
            rate_provenance: where it is known from, in words.
            expected_frames: number of pictures; None takes what there is.
            image_size_px: side of a square image or (width, height); None takes what comes.
            times: a CSV in the folder with the columns file and t, or ``names``: the last number in each file's name;
                None where the pictures are even.
            time_unit_s: seconds of a unit of these times.

        Raises:
            InputError: too few pictures, or neither a rate nor times that grow.
        """
        self.path, self.times = Path(path), None
        self._files = list_pictures(self.path)
        self.count = len(self._files)
        if self.count < FEWEST:
            raise InputError(path, f"{self.count} pictures", f"give a folder of {', '.join(PICTURES)}")
        if expected_frames not in (None, self.count):
            raise InputError(path, f"{self.count} pictures", f"{expected_frames} expected (expected_frames)")
        if times is not None:
            self._take_times(times, time_unit_s, rate_hz)
            self.rate_provenance = rate_provenance or f"times of the pictures ({times})"
        elif rate_hz is None:
            remedy = "set recordings.videos.rate_hz or .times (of expertaug inspect-video --rate or --times)"
            raise InputError(path, "pictures have no frame rate", remedy)
        else:
            self.rate_hz, self.rate_provenance = float(rate_hz), rate_provenance or "configured"
        if not RATES_HZ[0] <= self.rate_hz <= RATES_HZ[1]:
            raise InputError(path, f"{self.rate_hz:g} Hz", f"give {RATES_HZ[0]:g} to {RATES_HZ[1]:g}, or time_unit_s")
        first = self._read(0)
        self.height, self.width = first.shape[:2]
        if min(first.shape[:2]) < MIN_SIDE_PX or self.width * self.height > MAX_PX:
            raise InputError(
                path, f"pictures of {self.width}x{self.height} px", f"give {MIN_SIDE_PX} px a side or more"
            )
        if image_size_px is not None:
            wanted = (image_size_px,) * 2 if isinstance(image_size_px, int) else tuple(image_size_px)
            if (self.width, self.height) != wanted:
                problem = f"pictures are {self.width}x{self.height} px"
                raise InputError(path, problem, f"{wanted[0]}x{wanted[1]} expected (image_size_px)")
        self.layout = Layout("bgr24", self.width, self.height)

    def trim(self, from_s: float, to_s: float | None) -> None:
        """Give only the pictures of a span of time in s; None is the end.

        Raises:
            InputError: there are hardly any.
        """
        times = np.arange(self.count) / self.rate_hz if self.times is None else self.times
        kept = timestamps.span(self.path, times, from_s, to_s)
        self._files, self.count = self._files[kept.start : kept.stop], len(kept)
        if self.times is not None:
            self.times = self.times[kept.start : kept.stop] - self.times[kept.start]

    def _take_times(self, times: str, unit_s: float, rate_hz: float | None) -> None:
        if rate_hz is not None:
            raise InputError(self.path, f"rate_hz is {rate_hz:g} and times is {times!r}", "give one of them")
        times_s = (self._of_names() if times == NAMES else self._of_table(times)) * unit_s
        order = np.argsort(times_s, kind="stable")
        self._files, times_s = [self._files[k] for k in order], times_s[order]
        if self.count < 3:
            raise InputError(self.path, f"{self.count} pictures", "times need at least 3")
        tick = float(np.diff(np.unique(times_s)).min()) * 1e-3
        step, even = timestamps.judge(self.path, times_s, tick)
        self.rate_hz = 1 / step
        if not even:
            self.rate_hz, self.times = timestamps.in_seconds(1000 * times_s, None)

    def _of_names(self) -> np.ndarray:
        numbers = [NUMBER.findall(p.stem) for p in self._files]
        if any(not of for of in numbers):
            name = next(p.name for p, of in zip(self._files, numbers, strict=True) if not of)
            raise InputError(self.path, f"{name!r} has no number", "its time is to be the last number in its name")
        return np.array([float(of[-1]) for of in numbers])

    def _of_table(self, name: str) -> np.ndarray:
        path = self.path / name
        try:
            table = pd.read_csv(path, usecols=COLUMNS, dtype={"file": str}, skipinitialspace=True)
            times = dict(zip(table["file"].str.strip(), table["t"].astype(float), strict=True))
        except FileNotFoundError as error:
            raise InputError(path, "no such file", "give a CSV with the columns file and t") from error
        except (ValueError, OSError, AttributeError) as error:
            raise InputError(path, f"no table of times ({error})", "give a CSV with the columns file and t") from error
        missing = [p.name for p in self._files if not np.isfinite(times.get(p.name, np.nan))]
        if missing:
            raise InputError(
                path, f"no time of {missing[0]} ({len(missing)} are missing)", "add it, or remove the picture"
            )
        return np.array([times[p.name] for p in self._files])

    def _read(self, index: int) -> np.ndarray:
        data = np.fromfile(self._files[index], np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
        if image is None:
            raise InputError(self.path, f"{self._files[index].name} is no picture", "copy it again, or remove it")
        return image

    def frames(self, step: int = 1) -> Iterator[tuple[int, np.ndarray]]:
        """Every ``step``-th picture: index from 0 and image, uint8 BGR (height, width, 3).

        Raises:
            InputError: a file is no picture, or of another size.
        """
        for index in range(0, self.count, step):
            image = self._read(index)
            if image.shape[:2] != (self.height, self.width):
                problem = f"{self._files[index].name} is {image.shape[1]}x{image.shape[0]} px"
                raise InputError(self.path, problem, f"the first is {self.width}x{self.height} px: remove what differs")
            yield index, image

    pictures = frames

    def close(self) -> None:
        """Nothing is open."""

    def __enter__(self) -> Pictures:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


Frames = Video | Pictures


def open_frames(
    path: str | Path,
    stated: StatedTimes,
    expected_frames: int | None = None,
    image_size_px: int | tuple[int, int] | None = None,
) -> Frames:
    """Open and check a recording.

    Arguments:
        path: a video file, or a folder of pictures.
        stated: of its times.
        expected_frames, image_size_px: what it must have; None takes what comes.

    Raises:
        InputError: it cannot be used.
    """
    arguments = stated.rate_hz, stated.rate_provenance, expected_frames, image_size_px
    series = Path(path).is_dir()
    frames = Pictures(path, *arguments, stated.times, stated.time_unit_s) if series else Video(path, *arguments)
    if stated.from_s > 0 or stated.to_s is not None:
        try:
            frames.trim(stated.from_s, stated.to_s)
        except InputError:
            frames.close()
            raise
    return frames
