"""Markers at even times, from frames at times of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from expertaug_recordings.angles.timing import turns

POINTS = 4  # frames by which a place between them is interpolated: two on either side
LONGEST = 1.6  # nominal intervals between two of them
SAME = 1e-3  # of an interval, within which a time is a frame's own


@dataclass(frozen=True)
class Resampled:
    """Markers at m even times.

    Attributes:
        t: (m,) in s.
        source: (m,), the row of the nearest frame.
        place: (m, 3, 2) in px; NaN where the frames round a time were not all usable.
        kept: (m,), times that are a frame's own.
        error: (m, 2) in rad, the angles' estimated errors by interpolation; 0 where a time is a frame's own, NaN where
            too little is known.
    """

    t: np.ndarray
    source: np.ndarray
    place: np.ndarray
    kept: np.ndarray
    error: np.ndarray

    @property
    def error_deg(self) -> tuple[float, float] | None:
        """Median and 99th percentile of the worse angle's error in degrees; None where nothing was interpolated or too
        little is known."""
        between = np.isfinite(self.error).all(1) & ~self.kept & np.isfinite(self.place).all((1, 2))
        known = np.rad2deg(self.error[between].max(axis=1))
        return (float(np.median(known)), float(np.quantile(known, 0.99))) if len(known) else None


def resample(t: np.ndarray, place: np.ndarray, usable: np.ndarray, rate_hz: float) -> Resampled:
    """Interpolate the arms' angles and lengths by the cubic through four frames: a steady rotation stays one.

    The error is that of the cubic's remainder, with the fourth derivative that each frame shows that is left out of the
    cubic through its neighbours; the markers' noise adds to it, so that it is rather too large.

    Arguments:
        t: times (n,) in s, growing.
        place: pivot, joint and tip (n, 3, 2) in px.
        usable: (n,), frames that may be used.
        rate_hz: of the even times.
    """
    even = t[0] + np.arange(int(np.floor((t[-1] - t[0]) * rate_hz + 1e-6)) + 1) / rate_hz
    after = np.clip(np.searchsorted(t, even, side="right"), 1, len(t) - 1)
    source = after - (even - t[after - 1] <= t[after] - even)
    interval = max(float(np.median(np.diff(t))), 1 / rate_hz)
    kept = np.abs(t[source] - even) < SAME * interval
    out = np.full((len(even), 3, 2), np.nan)
    own = kept & usable[source]
    out[own] = place[source[own]]
    rows = after[:, None] + np.arange(-POINTS // 2, POINTS // 2)
    inside = (rows[:, 0] >= 0) & (rows[:, -1] < len(t))
    rows = np.clip(rows, 0, len(t) - 1)
    near = (np.diff(t[rows], axis=1) < LONGEST * interval).all(1)
    between = inside & near & usable[rows].all(1) & ~kept
    weights = _weights(t[rows[between]], even[between])
    arms = _arms(place)
    pivot, length, theta = (part[rows[between]] for part in arms)
    turned = theta[:, :1] + np.concatenate((np.zeros_like(theta[:, :1]), _cumulative(theta)), axis=1)
    at = [np.einsum("nm,nm...->n...", weights, part) for part in (pivot, length, turned)]
    out[between] = _places(*at)
    error = np.where(kept[:, None], 0.0, np.full((len(even), 2), np.nan))
    error[between] = _errors(t, np.where(usable[:, None], arms[2], np.nan), interval, even[between])
    return Resampled(even, source, out, kept, error)


def _arms(place: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pivot (n, 2), lengths (n, 2) and angles (n, 2) of markers (n, 3, 2)."""
    vector = np.diff(place, axis=1)
    return place[:, 0], np.linalg.norm(vector, axis=2), np.arctan2(vector[..., 0], vector[..., 1])


def _places(pivot: np.ndarray, length: np.ndarray, theta: np.ndarray) -> np.ndarray:
    vector = length[..., None] * np.stack((np.sin(theta), np.cos(theta)), axis=-1)
    return pivot[:, None] + np.concatenate((np.zeros_like(vector[:, :1]), np.cumsum(vector, axis=1)), axis=1)


def _cumulative(theta: np.ndarray) -> np.ndarray:
    """Turns since the first of m angles (n, m, k), the short way each time, (n, m − 1, k)."""
    return np.cumsum(np.angle(np.exp(1j * np.diff(theta, axis=1))), axis=1)


def _weights(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Lagrange's weights (n, m) of nodes (n, m) at places (n,)."""
    weights = np.ones_like(nodes)
    for j in range(nodes.shape[1]):
        for k in range(nodes.shape[1]):
            if k != j:
                weights[:, j] *= (at - nodes[:, k]) / (nodes[:, j] - nodes[:, k])
    return weights


def _errors(t: np.ndarray, theta: np.ndarray, interval: float, at: np.ndarray) -> np.ndarray:
    """Of both angles at the times ``at`` (m,), (m, 2) in rad; ``theta`` (n, 2) has NaN where a frame is not usable."""
    count = len(t) - POINTS
    if count < 1 or not len(at):
        return np.full((len(at), theta.shape[1]), np.nan)
    rows = np.arange(count)[:, None] + np.arange(POINTS + 1)
    turned = np.concatenate((np.zeros((count, 1, theta.shape[1])), np.cumsum(turns(theta)[rows[:, :-1]], axis=1)), 1)
    turned += 0 * theta[rows[:, :1]]
    others = [0, 1, 3, 4]
    nodes, middle = t[rows[:, others]], t[rows[:, 2]]
    left_out = turned[:, 2] - np.einsum("nm,nmk->nk", _weights(nodes, middle), turned[:, others])
    bent = np.full(theta.shape, np.nan)  # the fourth derivative over 24
    bent[2:-2] = left_out / np.prod(middle[:, None] - nodes, axis=1)[:, None]
    bent[2:-2][(np.diff(t[rows], axis=1) > LONGEST * interval).any(1)] = np.nan
    # The cubic through the two frames on either side of a time.
    after = np.clip(np.searchsorted(t, at, side="right"), 2, len(t) - 2)
    span = np.prod(np.abs(at[:, None] - t[after[:, None] + np.arange(-2, 2)]), axis=1)
    # The larger of what the frames on either side show: in fast motion it changes from frame to frame.
    bent = np.fmax(np.abs(bent[after - 1]), np.abs(bent[after]))
    return bent * span[:, None]
