"""A recording's markers as tracking or import left them: markers.csv, read, checked and put to even times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug_recordings.angles.conversion import Conversion, find_conversion
from expertaug_recordings.angles.even_times import find_dropped, find_repeated, resample
from expertaug_recordings.angles.mixtures import late_by, unmix, whole_half
from expertaug_recordings.angles.tearing import find_torn
from expertaug_recordings.corrections import Correction, correct
from expertaug_recordings.tables import BLENDED, MARKERS, PLACES, read_table

FEWEST = 10  # frames of a recording
EVEN = 0.01  # of an interval by which intervals may differ
MANY_REPEATED = 0.01  # of the frames
# Of frames torn at any row one in seven shows; in the others both markers are on one side, and show what the frame
# before or after shows.  Two such in a row vouch for each other: where a tenth of all frames are torn, in one of 100.
MOST_TORN, TEARING, MOST_OFF = 0.05, 0.01, 0.08  # shares: torn ones; torn ones, where torn and repeated ones are more
# Converters that do not double the rate make two fifths of their frames of nearly equal parts of two at most.
MOST_BLENDED = 0.45  # of the frames, above which all are mixtures
TEARABLE = ("", "arm_length", "residual")  # reasons of frames that may be torn
REPEATED, DROPPED, DISMISSED, TORN = "repeated", "dropped", "dismissed", "torn"  # reasons
UNTEAR = "take the camera's own file, or capture with vertical sync"


@dataclass(frozen=True)
class Timing:
    """What was found of a recording's times.

    Attributes:
        repeated, dropped: frames that show what the one before shows, and that are missing although times are even.
        torn: frames whose joint and tip are of different times.
        blended: frames that are mixtures of two.
        blended_used: whether these are used, since most of the frames are.
        uneven_ms: by how much the times were off even ones at most; 0 where they were even.
        frames_hz: frames per second where the places were resampled; None where each is a frame's own.
        error_deg: median and 99th percentile of the errors of the angles by that, estimated.
        converted_from_hz: frames per second of the video that this one was made from, whose times were put back; None
            where the motion tells of none.
    """

    repeated: int = 0
    dropped: int = 0
    torn: int = 0
    blended: int = 0
    blended_used: bool = False
    uneven_ms: float = 0.0
    frames_hz: float | None = None
    error_deg: tuple[float, float] | None = None
    converted_from_hz: float | None = None

    def mostly_torn(self, frames: int) -> bool:
        """Whether of so many frames that many are torn that the others are not to be trusted."""
        off = 0 if self.converted_from_hz is not None else self.torn + self.repeated
        return self.torn > MOST_TORN * frames or (self.torn > TEARING * frames and off > MOST_OFF * frames)

    def doubts(self, frames: int) -> list[str]:
        """What the times make doubtful, in plain words."""
        doubts = []
        if self.torn:
            doubts.append(
                f"{self.torn} of {frames} frames are torn, their upper part of another time than their lower one, and"
                f" were left out: {UNTEAR}"
            )
        if self.blended:
            what = f"{self.blended} frames are mixtures of two, as converters of frame rates make them,"
            doubts.append(
                f"{what} and others are fainter ones: they were used, at times that are off by up to a frame; use the"
                " original video"
                if self.blended_used
                else f"{what} and were left out: use the original video"
            )
        if self.converted_from_hz is not None:
            how = f"{self.repeated} frames repeat the one before" if self.repeated else "frames are missing"
            how = "frames are mixed" if self.blended else how
            return [
                *doubts,
                f"{how}: the motion is that of {self.converted_from_hz:.5g} frames/s brought to another rate; true"
                " times were put back, but the original video is better",
            ]
        if self.repeated > MANY_REPEATED * frames:
            doubts.append(
                f"{self.repeated} of {frames} frames repeat the one before: the video was made from one of another"
                " frame rate, and its times are off by up to a frame; use the original"
            )
        if self.dropped:
            doubts.append(
                f"the motion jumps as if {self.dropped} frames were missing between evenly timed ones: the times after"
                " them were moved on"
            )
        return doubts


@dataclass(frozen=True)
class MarkerTable:
    """Markers of n evenly timed frames.

    Attributes:
        frame: their numbers, (n,); of resampled ones the number of the even time.
        t: their times in s, (n,).
        rate_hz: frames per second.
        pivot, joint, tip: places (x, y) in px, y down, (n, 2); NaN where a marker was not found.
        quality: (n,), 0 where a frame is unusable.
        reason: (n,) texts: why, or empty.
        source: (n,), rows of the file that are nearest to them.
        corrected: (n,), frames in which a marker was placed by hand.
        timing: what was found of their times.
        interpolation: (n, 2) in rad, by how much the angles are estimated to be off by having been interpolated between
            frames; None where none was.
    """

    frame: np.ndarray
    t: np.ndarray
    rate_hz: float
    pivot: np.ndarray
    joint: np.ndarray
    tip: np.ndarray
    quality: np.ndarray
    reason: np.ndarray
    source: np.ndarray
    corrected: np.ndarray
    timing: Timing = field(default_factory=Timing)
    interpolation: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.t)

    @property
    def places(self) -> np.ndarray:
        """Pivot, joint and tip, (n, 3, 2) in px."""
        return np.stack((self.pivot, self.joint, self.tip), axis=1)


def read_markers(
    path: Path, rate_hz: float | None = None, corrections: Sequence[Correction] = (), single: bool = False
) -> MarkerTable:
    """Read a markers.csv; frames that are repeated or missing are found, uneven ones resampled.

    Arguments:
        rate_hz: frames per second that are wanted; None takes the file's own.
        single: the pendulum has no tip; it gets one that lies straight beyond its bob, so that both angles are one.
        corrections: markers that were placed by hand, and frames that are not to be used.

    Raises:
        InputError: the file is missing or no such table (:func:`expertaug_recordings.tables.read_table`), has too few
            frames, times that do not grow or many torn frames.
    """
    table = read_table(path, MARKERS[:-1], MARKERS[-1:], "track_markers")
    if len(table) < FEWEST:
        raise InputError(path, f"{len(table)} frames", f"a recording needs at least {FEWEST}")
    frame, t, quality, reason = (table[name].to_numpy().copy() for name in ("frame", "t", "quality", "reason"))
    interval = np.diff(t)
    if not (interval > 0).all():
        row = int(np.argmax(~(interval > 0)))
        problem = f"times do not grow: {t[row]} s, then {t[row + 1]} s"
        raise InputError(path, problem, "expected every analysed frame, in order of time")
    mean = (len(t) - 1) / (t[-1] - t[0])
    even = bool((np.abs(interval * mean - 1) < EVEN).all())
    own = float(round(mean, 6)) if even else 1 / float(np.median(interval))
    place, corrected, dismissed = correct(
        path, frame, table[list(PLACES)].to_numpy(float).reshape(-1, 3, 2), corrections
    )
    if single:
        place = with_twin(place)
    whole = corrected & np.isfinite(place).all((1, 2))
    quality[whole], reason[whole] = 1.0, ""
    lost = (corrected & ~whole) | dismissed
    quality[lost], reason[lost] = 0.0, np.where(dismissed[lost], DISMISSED, "lost")
    pivot, joint, tip = place.swapaxes(0, 1)
    rows = np.arange(len(t))
    made = on_time(MarkerTable(frame, t, own, pivot, joint, tip, quality, reason, rows, whole), even, rate_hz)
    if made.timing.mostly_torn(len(t)):
        share = f"{made.timing.torn} of {len(t)} frames are torn"
        problem = f"{share}: their upper part is of another time than their lower one"
        raise InputError(path, problem, UNTEAR)
    return made


def with_twin(place: np.ndarray) -> np.ndarray:
    """Places (n, 3, 2) of a single pendulum with a tip that lies straight beyond its bob."""
    place = place.copy()
    place[:, 2] = 2 * place[:, 1] - np.where(np.isfinite(place[:, 0]), place[:, 0], np.nanmedian(place[:, 0], axis=0))
    return place


def on_time(seen: MarkerTable, even: bool, rate_hz: float | None) -> MarkerTable:
    """The same at even times, without frames that show another time than theirs.

    Arguments:
        seen: at times of their own.
        even: whether these are even.
        rate_hz: frames per second that are wanted; None takes their own.
    """
    place, t, reason, quality = seen.places, seen.t, seen.reason, seen.quality
    good = np.isfinite(place).all((1, 2)) & (quality > 0) & (reason == "")
    if not good.any():
        return seen
    blended = reason == BLENDED
    half = whole_half(blended) if even else None
    if half is not None:
        reason = np.where(blended, "", reason)  # none of the others is mixed
        other = replace(seen, rate_hz=seen.rate_hz / 2, reason=reason)
        made = on_time(_rows(other, np.arange(half, len(t), 2)), even, rate_hz)
        source_hz = made.timing.converted_from_hz or seen.rate_hz / 2
        return replace(made, timing=replace(made.timing, blended=int(blended.sum()), converted_from_hz=source_hz))
    most = bool(blended.mean() > MOST_BLENDED)
    if most:
        reason[blended & (quality > 0)] = ""
        good |= np.isfinite(place).all((1, 2)) & blended & (quality > 0)
    torn = find_torn(t, place, good, ~seen.corrected & np.isin(reason, TEARABLE))
    if blended.any():  # then it is another image of one marker than of the other
        blended, torn = blended | torn, np.zeros_like(torn)
    reason[torn], quality[torn] = TORN, 0.0
    good &= ~torn
    if not most:
        reason[blended], quality[blended] = BLENDED, 0.0
        good &= ~blended
    # About the pivot's median: a single frame in which another thing is taken for it must not look like motion.
    vector = np.stack((place[:, 1] - np.median(place[good, 0], axis=0), place[:, 2] - place[:, 1]), axis=1)
    theta = np.where(good[:, None], np.arctan2(vector[..., 0], vector[..., 1]), np.nan)
    timing = Timing(torn=int(torn.sum()), blended=int(blended.sum()), blended_used=most)
    converted = find_conversion(theta, seen.rate_hz, None if most else blended) if even else None
    if converted is not None:
        return _undo(seen, converted, good, rate_hz, timing)
    if blended.any():
        seen = replace(seen, interpolation=late_by(theta))
    repeated = find_repeated(theta)
    reason[repeated], quality[repeated] = REPEATED, 0.0
    good &= ~repeated
    rows, missing = np.flatnonzero(good), np.zeros(len(t), dtype=int)
    if even and not torn.mean() > TEARING:  # where many are torn, a jump is that of a frame of another time
        missing[rows] = find_dropped(theta[rows], t[rows] * seen.rate_hz)
        t = t + np.cumsum(missing) / seen.rate_hz
    timing = replace(timing, repeated=int(repeated.sum()), dropped=int(missing.sum()))
    wanted = seen.rate_hz if rate_hz is None else rate_hz
    if even and not missing.any() and abs(seen.rate_hz / wanted - 1) < 1e-3:
        return replace(seen, timing=timing)
    timing = replace(timing, uneven_ms=0.0 if even else _off_even_ms(t), frames_hz=seen.rate_hz)
    return _resample(seen, t, good, wanted, timing)


def _undo(
    seen: MarkerTable, converted: Conversion, good: np.ndarray, rate_hz: float | None, timing: Timing
) -> MarkerTable:
    """The frames of a converted recording that show something new, at their true times, and evenly between them."""
    source_hz = converted.source_hz
    shown = np.cumsum(~converted.repeated)
    # Of those that show the same a good one, and that which is the least mixed with another.
    order = np.lexsort((np.abs(converted.later), ~good, shown))
    rows = order[np.unique(shown[order], return_index=True)[1]]
    new, good = _rows(seen, rows), good[rows]
    t = seen.t[0] + converted.t[rows]
    if converted.later.any():
        place = np.where(good[:, None, None], new.places, np.nan)
        place, error = unmix(place, np.rint(converted.t[rows] * source_hz), converted.later[rows])
        pivot, joint, tip = place.swapaxes(0, 1)
        new = replace(new, pivot=pivot, joint=joint, tip=tip, interpolation=error)
    timing = replace(
        timing,
        repeated=int(converted.repeated.sum()),
        uneven_ms=_off_even_ms(t),
        frames_hz=1 / float(np.median(np.diff(t))),
        converted_from_hz=source_hz,
    )
    wanted = rate_hz or min(source_hz, seen.rate_hz)
    return _resample(new, t, good, wanted, timing)


def _rows(seen: MarkerTable, rows: np.ndarray) -> MarkerTable:
    """Some of the frames."""
    each = ("frame", "t", "pivot", "joint", "tip", "quality", "reason", "source", "corrected")
    error = None if seen.interpolation is None else seen.interpolation[rows]
    return replace(seen, **{name: getattr(seen, name)[rows] for name in each}, interpolation=error)


def _resample(seen: MarkerTable, t: np.ndarray, good: np.ndarray, wanted: float, timing: Timing) -> MarkerTable:
    """Frames at times t (n,) in s, of which ``good`` (n,) can be used, at even times of ``wanted`` Hz."""
    reason, quality = seen.reason, seen.quality
    made = resample(t, seen.places, good, wanted)
    timing = replace(timing, error_deg=made.error_deg)
    lost = ~np.isfinite(made.place).all((1, 2))
    why = np.where(lost, np.where(reason[made.source] == "", DROPPED, reason[made.source]), "")
    pivot, joint, tip = made.place.swapaxes(0, 1)
    level = np.where(lost, 0.0, quality[made.source])
    number = np.arange(len(made.t))
    by_hand = seen.corrected[made.source] & made.kept
    source, off = seen.source[made.source], made.error
    off = off if seen.interpolation is None else np.hypot(off, seen.interpolation[made.source])
    return MarkerTable(number, made.t, wanted, pivot, joint, tip, level, why, source, by_hand, timing, off)


def _off_even_ms(t: np.ndarray) -> float:
    number = np.arange(len(t)) - (len(t) - 1) / 2
    step = number @ t / (number @ number)
    return 1000 * float(np.abs(t - t.mean() - step * number).max())
