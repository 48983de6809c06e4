"""Where gravity points in a video, and whether its camera looks askew, by the motion of the pendulum that it shows."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug_recordings.angles.arms import find_arms
from expertaug_recordings.angles.ellipse import View
from expertaug_recordings.angles.implied import SPAN_S
from expertaug_recordings.angles.marker_table import FEWEST, MarkerTable, on_time, with_twin
from expertaug_recordings.angles.noise import measure_noise
from expertaug_recordings.angles.quality import trust_tracker
from expertaug_recordings.angles.rectify import seen_through, worth_it
from expertaug_recordings.angles.single import fit_single
from expertaug_recordings.angles.smoothing import Smoothing, smooth_motion
from expertaug_recordings.angles.tilt import Gravity, find_gravity
from expertaug_recordings.angles.windows import longest_window
from expertaug_recordings.markers.geometry import Geometry
from expertaug_recordings.markers.tracker import track_frames
from expertaug_recordings.settings import AngleKeys, StatedTimes, TrackMarkersJob
from expertaug_recordings.video.source import open_frames

FRAMES, SECONDS = 300, 2.0  # from the middle of a video: so many frames, or seconds where that is more


def told_by_motion(
    path: Path,
    stated: StatedTimes,
    times: np.ndarray | None,
    geometry: Geometry,
    settings: TrackMarkersJob,
) -> tuple[Gravity | None, View | None]:
    """Direction of gravity in the image: 0 down, 90 right; None where the motion does not tell it.  And the view that
    makes the arms steadier; None where that is not worth it.

    Arguments:
        path: of the video.
        stated: of its times, what it does not say itself.
        times: of its frames in s, (n,), where they are uneven.
        geometry, settings: with which its markers are tracked.
    """
    with open_frames(path, stated) as video:
        rate = video.rate_hz if times is None else 1 / float(np.median(np.diff(times)))
        count = min(video.count, max(FRAMES, round(SECONDS * rate)))
        first = (video.count - count) // 2
        images = (image for number, image in islice(video.frames(), first + count) if number >= first)
        track = track_frames(images, geometry, settings)
    frames = np.arange(count)
    t = frames / rate if times is None else times[first : first + count]
    single = settings.appearance.tip is None
    if not np.isfinite(track.position[:, 0]).any():
        return None, None
    places = (with_twin(track.position) if single else track.position).swapaxes(0, 1)
    none = np.zeros(count, bool)
    reason = np.array(track.reason, object)
    markers = on_time(MarkerTable(frames, t, rate, *places, track.quality, reason, frames, none), times is None, rate)
    usable, _ = trust_tracker(markers)
    options = AngleKeys(model_offsets=not single)
    if usable.sum() < FEWEST or not np.isfinite(markers.pivot).any():
        return None, None
    view = worth_it(markers, usable, options.model_offsets)
    if view is not None:
        markers = seen_through(view.matrix, markers)
    arms = find_arms(markers, usable, options)
    fitting = usable & ~arms.off
    if fitting.sum() < FEWEST:
        return None, view
    order = options.smoothing_order
    noise, _ = measure_noise(arms.lengths, fitting, longest_window(order, rate))
    how = Smoothing(order, None, 0, options.outlier_sigmas, float(np.deg2rad(options.outlier_floor_deg)))
    motion = smooth_motion(np.where(fitting[:, None], arms.angles(0.0), np.nan), rate, noise, how)
    known = np.where(motion.margin[:, None], np.nan, motion.y)
    every = max(1, round(rate * SPAN_S))
    try:
        if single:
            return fit_single(known[:, [0, 2]], rate)[1], view
        return find_gravity(known, every / rate, every), view
    except InputError:
        return None, view
