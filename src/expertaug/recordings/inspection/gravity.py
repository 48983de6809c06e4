"""Where gravity points in a video, by the accelerations of the pendulum that it shows."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.recordings.angles.arms import find_arms
from expertaug.recordings.angles.implied import SPAN_S
from expertaug.recordings.angles.marker_table import FEWEST, MarkerTable
from expertaug.recordings.angles.noise import measure_noise
from expertaug.recordings.angles.quality import trust_tracker
from expertaug.recordings.angles.settings import AngleKeys
from expertaug.recordings.angles.smoothing import Smoothing, smooth_motion
from expertaug.recordings.angles.tilt import Gravity, find_gravity
from expertaug.recordings.angles.windows import longest_window
from expertaug.recordings.markers.geometry import Geometry
from expertaug.recordings.markers.settings import TrackSettings
from expertaug.recordings.markers.tracker import track_frames
from expertaug.recordings.video.reader import Video

FRAMES, SECONDS = 300, 2.0  # from the middle of a video: so many frames, or seconds where that is more


def gravity_in(path: Path, rate_hz: float | None, geometry: Geometry, settings: TrackSettings) -> Gravity | None:
    """Direction of gravity in the image: 0 down, 90 right; None where the motion does not tell it.

    Arguments:
        path, rate_hz: of the video; a rate of None is the file's own.
        geometry, settings: with which its markers are tracked.
    """
    with Video(path, rate_hz) as video:
        count = min(video.count, max(FRAMES, round(SECONDS * video.rate_hz)))
        first, rate = (video.count - count) // 2, video.rate_hz
        wanted = range(first, first + count)
        images = (
            video.layout.image_of(picture)
            for number, picture in zip(range(wanted.stop), (p for _, p in video.pictures()), strict=False)
            if number in wanted
        )
        track = track_frames(images, geometry, settings)
    frames = np.arange(count)
    places = track.position.swapaxes(0, 1)
    markers = MarkerTable(frames, frames / rate, rate, *places, track.quality, np.array(track.reason, object))
    usable, _ = trust_tracker(markers)
    options = AngleKeys()
    if usable.sum() < FEWEST or not np.isfinite(markers.pivot).any():
        return None
    arms = find_arms(markers, usable, options)
    fitting = usable & ~arms.off
    if fitting.sum() < FEWEST:
        return None
    order = options.smoothing_order
    noise, _ = measure_noise(arms.lengths, fitting, longest_window(order, rate))
    how = Smoothing(order, None, 0, options.outlier_sigmas, float(np.deg2rad(options.outlier_floor_deg)))
    motion = smooth_motion(np.where(fitting[:, None], arms.angles(0.0), np.nan), rate, noise, how)
    every = max(1, round(rate * SPAN_S))
    try:
        return find_gravity(np.where(motion.margin[:, None], np.nan, motion.y), every / rate, every)
    except InputError:
        return None
