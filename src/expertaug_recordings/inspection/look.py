"""What a video shows: its markers, where gravity points, and the keys of the configuration that would track it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug_recordings.angles.arms import find_arms
from expertaug_recordings.angles.marker_table import FEWEST, MarkerTable, on_time, with_twin
from expertaug_recordings.angles.noise import measure_noise
from expertaug_recordings.angles.pendulum_fit import SPAN_S, Gravity, find_gravity, fit_single
from expertaug_recordings.angles.quality import trust_tracker
from expertaug_recordings.angles.rectify import View, project_markers, worth_it
from expertaug_recordings.angles.smoothing import Smoothing, longest_window, smooth_motion
from expertaug_recordings.inspection.detect import MIN_FRAMES, Pendulum, Spot, by_hue, cleanest, look_for_pendulum
from expertaug_recordings.inspection.left_over import find_left_over
from expertaug_recordings.markers.appearance import COLOURS, ROLES, Colour
from expertaug_recordings.markers.geometry import Geometry, centre_of_circle, estimate_geometry
from expertaug_recordings.markers.tracker import track_frames
from expertaug_recordings.settings import AngleKeys, StatedTimes, TrackMarkersJob
from expertaug_recordings.video.declared import FilmedOtherwise
from expertaug_recordings.video.source import open_frames

RANGE_DEG = 25.0  # half a proposed range of hues, or less where markers are nearer to each other
RANGE_STRENGTH = 0.5  # share of a marker's saturation and value below which a colour is not taken for its
MIDDLE_FRAMES, SECONDS = 300, 2.0  # from the middle of a video: so many frames, or seconds where that is more
FRAMES, MEMORY = 24, 2**28  # frames that are looked at, and bytes that they may take
SHOWN = 6  # frames on the contact sheet
MIN_SHARE = 0.5  # of the frames in which the tracker must find all markers with what is proposed


def propose_tracking(pendulum: Pendulum) -> list[dict[str, object]]:
    """Settings of the tracker to try, the simplest first: colours by name, where names tell the markers apart, then as
    ranges of hue, saturation and value."""
    groups = [None if g is None else list(g.values()) for g in pendulum.spots]
    tints = [None if g is None else np.array([s.colour for s in g]) for g in groups]
    diameter = float(np.median([s.diameter for g in groups if g is not None for s in g]))
    settings: dict[str, object] = {"marker_diameter_px": round(diameter, 1)}
    kinds = [kind for kind in (_names(tints), _ranges(tints)) if kind is not None]
    return [{"markers": {"style": pendulum.style, **dict(zip(ROLES, kind, strict=True))}} | settings for kind in kinds]


def _names(tints: Sequence[np.ndarray | None]) -> list[str | None] | None:
    """Colours' names; None where they do not tell the markers apart."""
    names = [None if t is None else _name(_mean_hue(t[:, 0])) for t in tints]
    seen = [n for n in names if n is not None]
    named = [_all_named(t, name, seen) for t, name in zip(tints, names, strict=True) if t is not None]
    return names if len(set(seen)) == len(seen) and all(named) else None


def _ranges(tints: Sequence[np.ndarray | None]) -> list[dict[str, list[float]] | None]:
    hues = [None if t is None else _mean_hue(t[:, 0]) for t in tints]
    return [
        None if t is None else _range(t, hue, [h for h in hues if h is not None and h != hue])
        for t, hue in zip(tints, hues, strict=True)
    ]


def _mean_hue(hues: np.ndarray) -> float:
    return float(np.rad2deg(np.angle(np.exp(1j * np.deg2rad(hues)).mean())) % 360)


def _away(hue: np.ndarray | float, other: float) -> np.ndarray:
    return np.abs((np.asarray(hue) - other + 180) % 360 - 180)


def _name(hue: float) -> str:
    """The colour in whose range a hue lies best."""
    return max(COLOURS, key=lambda name: _inside(hue, name))


def _inside(hue: float, name: str) -> float:
    """Degrees to the nearer end of a colour's range, negative outside."""
    colour = Colour(name, COLOURS[name])
    return colour.reach - float(_away(hue, colour.middle))


def _all_named(tint: np.ndarray, name: str, among: Sequence[str]) -> bool:
    """Whether all of a marker's sightings are of a colour of this name, and of no other that is used."""
    colours = {other: Colour(other, COLOURS[other]) for other in among}
    own = colours[name]
    inside = (_away(tint[:, 0], own.middle) < 0.85 * own.reach).all()
    strong = (tint[:, 1] > 1.2 * own.saturation[0]).all() and (tint[:, 2] > 1.2 * own.value[0]).all()
    nearest = [min(colours, key=lambda other: float(_away(h, colours[other].middle))) for h in tint[:, 0]]
    return bool(inside and strong and set(nearest) == {name})


def _range(tint: np.ndarray, hue: float, others: Sequence[float]) -> dict[str, list[float]]:
    reach = min([RANGE_DEG, *(0.45 * float(_away(other, hue)) for other in others)])
    low = [RANGE_STRENGTH * float(np.median(tint[:, k])) for k in (1, 2)]
    return {
        "hue": [round((hue - reach) % 360), round((hue + reach) % 360)],
        "saturation": [round(low[0], 2), 1.0],
        "value": [round(low[1], 2), 1.0],
    }


def track_middle(
    path: Path, stated: StatedTimes, times: np.ndarray | None, geometry: Geometry, settings: TrackMarkersJob
) -> MarkerTable:
    """The markers in the middle of a video.

    Arguments:
        path: of the video.
        stated: of its times, what it does not say itself.
        times: of its frames in s, (n,), where they are uneven.
        geometry, settings: with which its markers are tracked.
    """
    with open_frames(path, stated) as video:
        rate = video.rate_hz if times is None else 1 / float(np.median(np.diff(times)))
        count = min(video.count, max(MIDDLE_FRAMES, round(SECONDS * rate)))
        first = (video.count - count) // 2
        images = (image for number, image in islice(video.frames(), first + count) if number >= first)
        track = track_frames(images, geometry, settings)
    frames = np.arange(count)
    t = frames / rate if times is None else times[first : first + count]
    places = track.position.swapaxes(0, 1)
    none = np.zeros(count, bool)
    return MarkerTable(frames, t, rate, *places, track.quality, np.array(track.reason, object), frames, none)


def find_gravity_and_view(tracked: MarkerTable, even: bool, single: bool) -> tuple[Gravity | None, View | None]:
    """Direction of gravity in the image: 0 down, 90 right; None where the motion does not tell it.  And the view that
    makes the arms steadier; None where that is not worth it.

    Arguments:
        tracked: markers in successive frames.
        even: whether their times are.
        single: whether they are a single pendulum's.
    """
    if not np.isfinite(tracked.pivot).any():
        return None, None
    rate = tracked.rate_hz
    both = replace(tracked, tip=with_twin(tracked.places)[:, 2]) if single else tracked
    markers = on_time(both, even, rate)
    usable, _ = trust_tracker(markers)
    options = AngleKeys(model_offsets=not single)
    if usable.sum() < FEWEST or not np.isfinite(markers.pivot).any():
        return None, None
    view = worth_it(markers, usable, options.model_offsets)
    if view is not None:
        markers = project_markers(view.matrix, markers)
    arms = find_arms(markers, usable, options)
    fitting = usable & ~arms.off
    if fitting.sum() < FEWEST:
        return None, view
    order = options.smoothing_order
    noise, _ = measure_noise(arms.lengths, fitting, longest_window(order, rate))
    how = Smoothing(order, None, 0, options.outlier_sigmas, float(np.deg2rad(options.outlier_floor_deg)))
    motion = smooth_motion(np.where(fitting[:, None], arms.angles(0.0), np.nan), rate, noise, how)
    states = np.where(motion.margin[:, None], np.nan, motion.y)
    every = max(1, round(rate * SPAN_S))
    try:
        if single:
            return fit_single(states[:, [0, 2]], rate)[1], view
        return find_gravity(states, every / rate, every), view
    except InputError:
        return None, view


@dataclass(frozen=True)
class Footage:
    """Frames (H, W, 3) spread over a video with their numbers, what the file says of itself (times (n,) in s of its
    frames where they are uneven), and what is stated, by its user or by a tag of the file on which a note says so."""

    path: Path
    frames: list[np.ndarray]
    numbers: list[int]
    rate_hz: float
    count: int
    times: np.ndarray | None
    stated: StatedTimes
    note: str = ""

    @property
    def facts(self) -> str:
        height, width = self.frames[0].shape[:2]
        seconds = self.count / self.rate_hz
        times = " (variable)" if self.times is not None else ""
        return f"{width}x{height} px, {self.rate_hz:.6g} Hz{times}, {self.count} frames, {seconds:.2f} s"


@dataclass(frozen=True)
class Look:
    """What was seen of a video.

    Attributes:
        footage: its frames.
        spots: round coloured things by style.
        pendulum: its markers with their roles; None where there is none.
        tracking: keys of the configuration that are proposed.
        gravity: its direction in the image; None where the motion does not tell it.
        view: of a camera that looks askew; None where it is not worth correcting.
        geometry: lengths with these; None where they find too little.
        counts: frames in which each marker and all are found.
        refusal: why nothing can be proposed; empty otherwise.
    """

    footage: Footage
    spots: Mapping[str, Sequence[Spot]]
    pendulum: Pendulum | None = None
    tracking: Mapping[str, object] = field(default_factory=dict)
    gravity: Gravity | None = None
    geometry: Geometry | None = None
    counts: Counter = field(default_factory=Counter)
    refusal: str = ""
    view: View | None = None

    @property
    def notes(self) -> list[str]:
        """What its user should know of it."""
        beside = []
        if self.pendulum is not None:
            beside = find_left_over(self.pendulum, self.spots[self.pendulum.style], len(self.footage.frames))
        return ([self.footage.note] if self.footage.note else []) + beside


def look_at(video: Path, stated: StatedTimes) -> Look:
    """Look for a pendulum's markers.

    Raises:
        InputError: the video cannot be used.
    """
    footage = _read(video, stated)
    pendulum, spots = look_for_pendulum(footage.frames)
    if pendulum is None:
        return Look(footage, spots, refusal=_missing(spots, len(footage.frames)))
    tracking, geometry, counts = _best_proposal(footage.frames, propose_tracking(pendulum))
    if geometry is None or counts["all"] < MIN_SHARE * counts["frames"]:
        refusal = f"its markers are all found in {counts['all']} of {counts['frames']} frames only"
        return Look(footage, spots, pendulum, tracking, None, geometry, counts, refusal)
    settings = TrackMarkersJob.from_mapping(tracking)
    markers = track_middle(video, footage.stated, footage.times, geometry, settings)
    gravity, view = find_gravity_and_view(markers, footage.times is None, settings.appearance.tip is None)
    return Look(footage, spots, pendulum, tracking, gravity, geometry, counts, view=view)


def count_with(frames: Sequence[np.ndarray], tracking: Mapping[str, object]) -> int:
    """Frames in which the tracker finds all markers with these settings."""
    return _best_proposal(frames, [tracking])[2]["all"]


def _read(path: Path, stated: StatedTimes) -> Footage:
    """As :func:`_frames_of`; where a tag says that a video was filmed at another rate than it is shown, that is stated,
    as long as its user states none."""
    try:
        return _frames_of(path, stated)
    except FilmedOtherwise as error:
        from_tag = {"rate_hz": error.rate_hz, "rate_provenance": f"the file's tag {error.tag}"}
        note = f"filmed at {error.rate_hz:g} Hz by its tag {error.tag} and shown at {error.shown_hz:g} Hz: rate_hz says"
        note += f" so; if the tag is wrong, give --rate {error.shown_hz:g}"
        return replace(_frames_of(path, stated.model_copy(update=from_tag)), note=note)


def _frames_of(path: Path, stated: StatedTimes) -> Footage:
    """All of the video is decoded, since only that tells whether it is sound and when its frames were taken."""
    with open_frames(path, stated) as video:
        wanted = max(SHOWN, min(FRAMES, MEMORY // (video.width * video.height * 3)))
        step = max(1, video.count // wanted)
        kept = [(number, image.copy()) for number, image in video.frames(step)][:wanted]
        if not kept:
            raise InputError(path, "has no frames", "copy the recording again")
        frames, numbers = [f for _, f in kept], [n for n, _ in kept]
        return Footage(path, frames, numbers, video.rate_hz, video.count, video.times, stated)


def _best_proposal(
    frames: Sequence[np.ndarray], proposals: Sequence[Mapping]
) -> tuple[Mapping, Geometry | None, Counter]:
    """The settings with which the tracker finds all markers in the most frames, the first of equals."""
    tried = []
    for proposal in proposals:
        try:
            tried.append((proposal, *estimate_geometry(frames, TrackMarkersJob.from_mapping(proposal))))
        except InputError:  # the tracker sees too little of the joint to find the pivot
            tried.append((proposal, None, Counter(frames=len(frames))))
    return max(tried, key=lambda trial: trial[2]["all"])


def _missing(spots: Mapping[str, Sequence[Spot]], frames: int) -> str:
    """Why no pendulum was found."""
    many = Counter({style: len({s.frame for s in seen}) for style, seen in spots.items()})
    style, seen = many.most_common(1)[0]
    if not seen:
        return f"no round coloured markers in {frames} frames"
    hues = sorted({round(s.colour[0] / 20) * 20 % 360 for s in spots[style]})
    listed = ", ".join(f"{hue}°" for hue in hues[:8])
    return (
        f"round {style}s of hues near {listed} in {seen} of {frames} frames, but no two or three of different colours"
        f" that keep their distances while they swing about a fixed point{_short_swing(spots[style])}"
    )


def _short_swing(spots: Sequence[Spot]) -> str:
    """What helps where something swings too little to tell where its pivot is; empty otherwise."""
    for group in by_hue(spots):
        own = cleanest(group)
        centres = np.array([spot.centre for spot in own.values()])
        moves = float(np.hypot(*np.ptp(centres, axis=0)))
        if len(own) >= MIN_FRAMES and moves > float(np.median([spot.diameter for spot in own.values()])):
            try:
                centre_of_circle(centres)
            except InputError as error:
                problem = error.found.replace("the joint", f"the one of hue {own[min(own)].colour[0]:.0f}°")
                return f" ({problem} unless that has a marker; else say where it is: {error.remedy})"
    return ""
