"""A video with what was measured drawn over the frames: markers, arms, angles and, where there are any, forecasts."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation.forecasts import Forecasts
from expertaug.files import atomic
from expertaug_recordings.angles.quality import INTERPOLATED, MEASURED, UNUSABLE
from expertaug_recordings.angles.summary import RecordingSummary
from expertaug_recordings.reports import drawing
from expertaug_recordings.settings import OverlayJob
from expertaug_recordings.tables import PLACES, read_table
from expertaug_recordings.video.source import open_frames
from expertaug_recordings.video.writer import encode

ANGLES = ("theta1", "theta2")
HEIGHTS = (480, 1080)  # px of the frames in the overlay: smaller ones are enlarged, larger ones reduced
PANEL, MARGIN = 170, 8  # px of the panel of angles below, and round it
WINDOW_S, NOW = 3.0, 0.7  # seconds of angles that the panel shows, and where in it the present is
AROUND_S = 0.5  # shown before and after a forecast outside of the chosen part
HOLD_S = 1.0  # for which the end of a forecast is held
CRF, SPEED = 23, "veryfast"
THETA = ((255, 200, 90), (90, 170, 255))  # B, G, R of the angles
GHOSTS = ((255, 90, 255), (90, 255, 255), (90, 255, 90), (255, 255, 90))
SHADES = {MEASURED: (90, 200, 90), INTERPOLATED: (0, 170, 255), UNUSABLE: (60, 60, 255)}
STATES = {MEASURED: "measured", INTERPOLATED: "not used", UNUSABLE: "unusable"}


@dataclass(frozen=True)
class Forecast:
    """Forecast angles (n, 2) in rad at the rows (n,) of a recording, by the method of this label."""

    label: str
    rows: np.ndarray
    theta: np.ndarray

    def at(self, row: int) -> np.ndarray:
        """Angles (2,) at a row between the first and the last."""
        return np.array([np.interp(row, self.rows, self.theta[:, k]) for k in range(2)])


def read_forecasts(
    files: Mapping[str, str | Path], recording: str, frame: np.ndarray, rate_hz: float
) -> list[Forecast]:
    """Those forecasts that are of a recording, in order of time; by each method's first seed.

    Arguments:
        files: forecasts.npz (:mod:`expertaug.evaluation.forecasts`) by the method's label.
        recording: its name.
        frame: (n,), the numbers of its rows' frames, ascending.
        rate_hz: rows per second.

    Raises:
        InputError: a file cannot be used, does not say of which chunks it is or is of frames that are not there.
    """
    forecasts = [
        forecast
        for label, path in files.items()
        for forecast in forecasts_of(label, Forecasts.load(Path(path)), recording, frame, rate_hz, path)
    ]
    return sorted(forecasts, key=lambda forecast: int(forecast.rows[0]))


def forecasts_of(
    label: str, stored: Forecasts, recording: str, frame: np.ndarray, rate_hz: float, where: object = "forecasts"
) -> Iterator[Forecast]:
    """A method's forecasts of a recording; arguments and errors are those of :func:`read_forecasts`."""
    if not set(ANGLES) <= set(stored.state_names):
        return
    columns = [stored.state_names.index(name) for name in ANGLES]
    steps = np.rint((stored.t - stored.t[0]) * rate_hz).astype(int)
    for name, kept in stored.kept.items():
        if kept.id is None:
            raise InputError(where, f"does not say of which chunks its {name} forecasts are", "run evaluate again")
        for identity, states in zip(kept.id, kept.prediction[0], strict=True):
            of, _, first = str(identity).rpartition("/")
            if of != recording:
                continue
            start = int(np.searchsorted(frame, int(first))) if first.isdecimal() else len(frame)
            if start + steps[-1] >= len(frame) or frame[start] != int(first):
                problem = f"forecasts {str(identity)!r} over {steps[-1] + 1} frames"
                raise InputError(where, problem, f"{recording} has no such frames: run evaluate again")
            yield Forecast(label, start + steps, states[:, columns].astype(float))


@dataclass(frozen=True)
class Measured:
    """One recording: its summary, frame numbers (n,), rows of the markers' table (n,), times (n,), marker places
    (n, 3, 2) px, angles (n, 2) rad, quality (n,) and reasons (n,)."""

    summary: RecordingSummary
    frame: np.ndarray
    source: np.ndarray
    t: np.ndarray
    place: np.ndarray
    theta: np.ndarray
    quality: np.ndarray
    reason: np.ndarray


@dataclass(frozen=True)
class Schedule:
    """What an overlay shows.

    Attributes:
        rows: of the measurement, that are shown, ascending.
        stride: rows from one to the next.
        fps: frames per second of the overlay.
    """

    rows: np.ndarray
    stride: int
    fps: float


def schedule(seen: Measured, predicted: Sequence[Forecast], job: OverlayJob) -> Schedule:
    """What an overlay of a measurement and its forecasts shows.

    Raises:
        InputError: nothing of the recording is in the chosen part.
    """
    rate = seen.summary.rate_hz
    stride = max(1, round(rate * job.speed / job.fps))
    rows = _rows(seen, predicted, job, stride)
    if not len(rows):
        problem = f"{job.start_s:g} s is after its end at {seen.t[-1]:.2f} s"
        raise InputError("recordings.overlay.start_s", problem, "choose an earlier part")
    return Schedule(rows, stride, rate * job.speed / stride)


def run_stage(
    video: str | Path,
    markers: str | Path,
    angles: str | Path,
    summary: str | Path,
    output: str | Path,
    job: OverlayJob,
    forecasts: Mapping[str, str | Path] | None = None,
) -> None:
    """Stage: draw the measurement of a recording over its frames, as H.264 video that a browser plays.

    Arms are white where a frame is measured, orange where it is not used (there from the angles) and missing where it
    is unusable.  Each forecast of a chunk of this recording swings beside it, and its end is held.

    Arguments:
        video: the recording's video.
        markers, angles, summary: what the stage measure-angles read and wrote.
        output: .mp4.
        job: what is shown.
        forecasts: forecasts.npz by the label to print.

    Raises:
        InputError: a file cannot be used or does not fit the others, or nothing of the recording is in the chosen part.
    """
    cv2.setNumThreads(1)
    if Path(output).suffix.lower() != ".mp4":
        raise InputError(output, f"suffix '{Path(output).suffix}'", "an overlay is .mp4")
    seen = _read(markers, angles, summary)
    rate = seen.summary.rate_hz
    predicted = read_forecasts(forecasts or {}, seen.summary.recording, seen.frame, rate)
    shown = schedule(seen, predicted, job)
    with open_frames(video, job) as source:
        step = max(1, math.floor(source.rate_hz / rate + 1e-3))
        other = seen.summary.timing.frames_hz is None and abs(step * rate / source.rate_hz - 1) > 1e-3
        if other or int(seen.source.max()) * step >= source.count:
            problem = f"{source.count} frames at {source.rate_hz:g} Hz"
            raise InputError(
                video, problem, f"{markers} has {len(seen.t)} at {rate:g} Hz: give the video that it is of"
            )
        painter = Painter(seen, predicted, (source.width, source.height))
        with atomic(output) as temporary:
            images = overlay(painter, shown, source.frames(step), step)
            encode(temporary, images, painter.size, shown.fps, CRF, SPEED, flags="+faststart")


def overlay(
    painter: Painter, shown: Schedule, frames: Iterable[tuple[int, np.ndarray]], step: int = 1
) -> Iterator[np.ndarray]:
    """The frames of an overlay.

    Arguments:
        frames: number and image of every ``step``-th frame of the video, which are asked for one after the other.
    """
    seen = painter.seen
    wanted: dict[int, list[int]] = {}
    for row in shown.rows:
        wanted.setdefault(int(seen.source[row]) * step, []).append(int(row))
    for number, frame in frames:
        if number > max(wanted):
            return
        for row in wanted.get(number, ()):
            image = painter.paint(frame, row)
            yield image
            if any(0 <= row - forecast.rows[-1] < shown.stride for forecast in painter.predicted):
                for _ in range(round(HOLD_S * shown.fps)):
                    yield image


def note(words: str, output: str | Path) -> None:
    """A short video that only says why there is no other."""
    image = np.zeros((120, 960, 3), np.uint8)
    for k, line in enumerate(textwrap.wrap(words, 110)[:4]):
        drawing.text(image, line, (MARGIN, 24 + 22 * k))
    with atomic(output) as temporary:
        encode(temporary, iter([image] * 50), (960, 120), 25, CRF, SPEED, flags="+faststart")


def _read(markers: str | Path, angles: str | Path, summary: str | Path) -> Measured:
    points = read_table(markers, ("frame", *PLACES), made_by="track_markers")
    table = read_table(angles, ("frame", "t", "theta1", "theta2", "quality", "source"), ("reason",))
    return read_measured(points, table, RecordingSummary.load(summary), (markers, angles, summary))


def read_measured(
    points: pd.DataFrame,
    table: pd.DataFrame,
    summary: RecordingSummary,
    where: tuple[object, object, object] = ("markers", "angles", "summary"),
) -> Measured:
    """What was measured of a recording.

    Arguments:
        points: frame and places of the markers, :data:`~expertaug_recordings.tables.PLACES`, of each analysed frame.
        table: of the angles: frame, t, theta1, theta2, quality, reason, and source: rows of ``points``.
        where: what messages call these three.

    Raises:
        InputError: they are not of one measurement.
    """
    resampled = summary.timing.frames_hz is not None
    same = resampled or (len(points) == len(table) and (points["frame"] == table["frame"]).all())
    source = table["source"].to_numpy()
    if not (same and len(table) == summary.frames and ((source >= 0) & (source < len(points))).all()):
        counts = f"{len(points)} frames, {where[1]} has {len(table)}, {where[2]} has {summary.frames}"
        raise InputError(where[0], counts, "they are not of one measurement: run measure_angles again")
    if not table["quality"].isin(list(SHADES)).all():
        raise InputError(where[1], "a frame without a quality of 0, .5 or 1", "run measure_angles again")
    place = points[list(PLACES)].to_numpy().reshape(-1, 3, 2)[source.astype(int)]
    frame, t, quality, reason = (table[name].to_numpy() for name in ("frame", "t", "quality", "reason"))
    theta = table[["theta1", "theta2"]].to_numpy()
    return Measured(summary, frame, source.astype(int), t, place, theta, quality, reason)


def _rows(seen: Measured, predicted: Sequence[Forecast], job: OverlayJob, stride: int) -> np.ndarray:
    """Rows that are shown: of the chosen part and round every forecast."""
    t = seen.t - seen.t[0]
    end = math.inf if job.duration_s is None else job.start_s + job.duration_s
    shown = (t >= job.start_s) & (t < end)
    if shown.any():
        for forecast in predicted:
            shown |= (t >= t[forecast.rows[0]] - AROUND_S) & (t <= t[forecast.rows[-1]] + AROUND_S)
    return np.flatnonzero(shown & (np.arange(len(t)) % stride == 0))


class Painter:
    """Paints frames with what was measured in them, and a panel of the angles below."""

    def __init__(self, seen: Measured, predicted: Sequence[Forecast], size: tuple[int, int]) -> None:
        self.seen, self.predicted = seen, predicted
        labels = dict.fromkeys(forecast.label for forecast in predicted)
        self.ghosts = {label: GHOSTS[k % len(GHOSTS)] for k, label in enumerate(labels)}
        width, height = size
        self.factor = max(1.0, HEIGHTS[0] / height) if height < HEIGHTS[1] else HEIGHTS[1] / height
        self.frame_size = round(width * self.factor), round(height * self.factor)
        self.size = self.frame_size[0] + self.frame_size[0] % 2, self.frame_size[1] + PANEL + (self.frame_size[1] % 2)
        summary = seen.summary
        self.arms = np.array((summary.arm1_px, summary.arm2_px))
        self.pivot = np.array((summary.pivot_x_px, summary.pivot_y_px))
        self.gravity = math.radians(summary.rotation_deg)  # its direction in the image
        self.radius = max(4.0, 0.11 * float(self.arms.min())) * self.factor

    def places(self, theta: np.ndarray) -> np.ndarray:
        """Pivot, joint and tip (3, 2) in px of angles (2,)."""
        at = theta + self.gravity
        step = self.arms[:, None] * np.stack((np.sin(at), np.cos(at)), axis=1)
        return np.stack((self.pivot, self.pivot + step[0], self.pivot + step.sum(0)))

    def paint(self, frame: np.ndarray, row: int) -> np.ndarray:
        """The overlay's frame (height, width, 3) of a row."""
        seen, image = self.seen, np.zeros((self.size[1], self.size[0], 3), np.uint8)
        view = image[: self.frame_size[1], : self.frame_size[0]]
        view[:] = frame if self.factor == 1 else drawing.resize(frame, self.factor)[: view.shape[0], : view.shape[1]]
        quality, theta = float(seen.quality[row]), seen.theta[row]
        if quality == MEASURED:
            drawing.pendulum(view, seen.place[row] * self.factor, self.radius)
        elif np.isfinite(theta).all():
            drawing.line(view, self.places(theta) * self.factor, SHADES[INTERPOLATED])
        now = [f for f in self.predicted if f.rows[0] <= row <= f.rows[-1]]
        for forecast in now:
            ghost = self.places(forecast.at(row)) * self.factor
            drawing.line(view, ghost, self.ghosts[forecast.label])
            drawing.ring(view, ghost[2], self.radius, self.ghosts[forecast.label])
        self._words(view, row, quality, now)
        self._panel(image[self.frame_size[1] :], row)
        return image

    def _words(self, view: np.ndarray, row: int, quality: float, now: Sequence[Forecast]) -> None:
        seen = self.seen
        drawing.text(view, f"{seen.summary.recording}   t = {seen.t[row]:.3f} s", (MARGIN, 20))
        why = f": {seen.reason[row]}" if seen.reason[row] else ""
        drawing.text(view, f"{STATES[quality]}{why}", (MARGIN, 40), SHADES[quality])
        for k, forecast in enumerate(now):
            off = np.rad2deg(np.angle(np.exp(1j * (forecast.at(row) - seen.theta[row]))))
            span = seen.t[row] - seen.t[forecast.rows[0]]
            words = f"{forecast.label}: forecast over {span:.2f} s, off by {off[0]:+.1f} and {off[1]:+.1f} deg"
            drawing.text(view, words, (MARGIN, 60 + 20 * k), self.ghosts[forecast.label])

    def _panel(self, panel: np.ndarray, row: int) -> None:
        """Angles over time round the present, a band of the frames' quality and the present's values."""
        seen, t = self.seen, self.seen.t
        panel[:] = 24
        height, width = panel.shape[:2]
        top, bottom = 26, height - 16
        begin = t[row] - NOW * WINDOW_S
        first, last = np.searchsorted(t, (begin, begin + WINDOW_S))
        span = slice(first, max(last, first + 1))

        def across(time: np.ndarray | float) -> np.ndarray:
            return MARGIN + (np.asarray(time) - begin) / WINDOW_S * (width - 2 * MARGIN)

        def down(angle: np.ndarray) -> np.ndarray:
            return (top + bottom) / 2 - angle / math.pi * (bottom - top) / 2

        for level in (-1.0, 0.0, 1.0):
            ends = np.array([[MARGIN, down(level * math.pi)], [width - MARGIN, down(level * math.pi)]])
            drawing.line(panel, ends, (70, 70, 70), shade=False)
        for k, colour in enumerate(THETA):
            _trace(panel, across(t[span]), seen.theta[span, k], down, colour)
            for forecast in self.predicted:
                if forecast.rows[0] <= row:
                    _trace(panel, across(t[forecast.rows]), forecast.theta[:, k], down, self.ghosts[forecast.label])
        x = float(across(t[row]))
        drawing.line(panel, np.array([[x, top], [x, bottom]]), drawing.ARM, shade=False)
        for value, shade in SHADES.items():
            for place in across(t[span][seen.quality[span] == value]).round().astype(int):
                panel[-8:-3, max(0, place - 1) : place + 1] = shade
        for k, angle in enumerate(seen.theta[row].tolist()):
            angle_text = (
                f"{math.degrees(math.remainder(angle, 2 * math.pi)):+.1f} deg" if math.isfinite(angle) else "unknown"
            )
            drawing.text(panel, f"theta{k + 1} {angle_text}", (MARGIN + 150 * k, 17), THETA[k])
        drawing.text(panel, "-180 to 180 deg", (width - 120, 17), (150, 150, 150), 0.4)


def _trace(panel: np.ndarray, x: np.ndarray, angle: np.ndarray, down: object, colour: Sequence[int]) -> None:
    """An angle over time, cut where it is unknown or passes ±π."""
    wrapped = np.angle(np.exp(1j * angle))
    points = np.stack((x, down(wrapped)), axis=1)
    cuts = np.flatnonzero(~(np.abs(np.diff(wrapped)) < math.pi)) + 1
    for part in np.split(points, cuts):
        part = part[np.isfinite(part).all(1)]
        if len(part) > 1:
            drawing.line(panel, part, colour, shade=False)
