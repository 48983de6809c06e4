"""Markers at even times: frames that are repeated or missing although times are even, and places between frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STILL = 0.1  # of the motion between the neighbours, below which a frame repeats the one before
MOVING = np.deg2rad(1.0)  # per frame: slower motion does not tell
HALF, ORDER = 3, 3  # frames on either side of a jump, and order of the polynomial through them
EARLY = 0.5  # of the one's misfit that the other of two like frames has at most where the first is of a later time
MISSING = (2.0, 3.0, 4.0)  # steps that a jump may take
STRANGE, NOISE = 6.0, np.deg2rad(0.3)  # a jump's misfit, in medians of all, and at least
BETTER, STILL_BETTER = (
    0.25,
    0.5,
)  # of that misfit at most, where frames are missing; without the frames next to the jump
POINTS = 4  # frames by which a place between them is interpolated: two on either side
LONGEST = 1.6  # nominal intervals between two of them
MANY = 0.05  # share of longer intervals, from which single missing frames are bridged
OVER_ONE = 2.3  # of the frame interval, how long those may be then
SAME = 1e-3  # of an interval, within which a time is a frame's own


def turns(theta: np.ndarray) -> np.ndarray:
    """By how much angles (n, k) turn from each row to the next, in (−π, π], (n − 1, k)."""
    return np.angle(np.exp(1j * np.diff(theta, axis=0)))


def step_of(theta: np.ndarray) -> np.ndarray:
    """How far angles (n, k) in rad turn at each row, on a mean of both sides, (n, k); also where they are NaN."""
    number = np.flatnonzero(np.isfinite(theta).all(1))
    way = np.cumsum(np.abs(turns(theta[number])), axis=0)
    return np.gradient(np.stack([np.interp(np.arange(len(theta)), number[1:], of) for of in way.T], axis=1), axis=0)


def find_repeated(theta: np.ndarray) -> np.ndarray:
    """Frames (n,) that show what the one before showed, or what the next will, while the motion goes on round them.

    Of two that show the same it is the one that is further off the frames around both.  At a turning point the
    neighbours' motions cancel: there nothing is said.

    Arguments:
        theta: angles (n, k) in rad; NaN where they are not known.
    """
    repeated = np.zeros(len(theta), dtype=bool)
    if len(theta) < 4:
        return repeated
    step = turns(theta)
    expected = np.linalg.norm(step[:-2] + step[2:], axis=1) / 2
    with np.errstate(invalid="ignore"):
        repeated[2:-1] = (expected > MOVING) & (np.linalg.norm(step[1:-1], axis=1) < STILL * expected)
    late = np.flatnonzero(repeated)
    late = late[(late >= 3) & (late < len(theta) - 2)]
    first, second = (_off_around(theta, late, shown) for shown in (late - 1, late))
    early = late[second < EARLY * first]
    repeated[early] = False
    repeated[early - 1] = True
    return repeated


def _off_around(theta: np.ndarray, late: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """Distances (m,) in rad of the angles of the frames ``shown`` (m,) from the cubics through those round the frames
    ``late`` (m,) and the ones before them."""
    rows = late[:, None] + np.array([-3, -2, 1, 2])
    first = theta[rows[:, :1]]
    turned = np.concatenate((np.zeros_like(first), _cumulative(theta[rows])), axis=1)
    between = first[:, 0] + np.einsum("nm,nmk->nk", lagrange(rows.astype(float), shown.astype(float)), turned)
    return np.linalg.norm(np.angle(np.exp(1j * (theta[shown] - between))), axis=1)


def find_dropped(theta: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Frames (n,) that are missing before each row: the motion jumps as if so much more time had passed.

    It must do so also without the frame before the jump and without that after it: a wrong marker in one of them does
    not.

    Arguments:
        theta: angles (n, k) in rad of consecutive frames; NaN where they are not known.
        t: times (n,) in steps.
    """
    missing = np.zeros(len(theta), dtype=int)
    first = HALF + 1
    count = len(theta) - 2 * first + 1
    if count < 1:
        return missing
    rows = first + np.arange(count)
    near, before, after = (_misfits(theta, t, rows, *skipped) for skipped in ((0, 0), (1, 0), (0, 1)))
    if not np.isfinite(near).any():
        return missing
    best, chosen = np.min(near[1:], axis=0), np.argmin(near[1:], axis=0)[None]
    with np.errstate(invalid="ignore"):
        strange = (near[0] > max(STRANGE * float(np.nanmedian(near[0])), NOISE)) & (best < BETTER * near[0])
        for other in (before, after):
            strange &= np.take_along_axis(other[1:], chosen, axis=0)[0] < STILL_BETTER * other[0]
    for k in np.flatnonzero(strange):
        around = slice(max(0, k - HALF), k + HALF + 1)
        if best[k] <= np.nanmin(best[around][strange[around]]):
            missing[first + k] = int(MISSING[int(np.argmin(near[1:, k]))]) - 1
    return missing


def _misfits(theta: np.ndarray, t: np.ndarray, rows: np.ndarray, before: int, after: int) -> np.ndarray:
    """What is left of windows before and from each of the rows (m,) on by a polynomial through both, (1 + k, m): as the
    times have it, and where each of the k numbers of frames in MISSING passes at the row.

    Arguments:
        before, after: frames that are left out before the row, and from it on.
    """
    offsets = np.concatenate((np.arange(-HALF, 0) - before, np.arange(HALF) + after))
    through = np.arange(offsets[0], offsets[-1] + 1)
    every = rows[:, None] + through
    turned = np.concatenate(
        (np.zeros((len(rows), 1, theta.shape[1])), np.cumsum(turns(theta)[every[:, :-1]], axis=1)), 1
    )
    inside = np.isin(through, offsets)
    window, time = turned[:, inside], t[every[:, inside]] - t[rows - 1][:, None]
    usable = np.isfinite(turned).all((1, 2)) & (time[:, -1] - time[:, 0] < 2 * HALF + 1 + before + after)
    out = np.full((1 + len(MISSING), len(rows)), np.nan)
    for k, steps in enumerate((1.0, *MISSING)):
        late = time + (steps - 1) * (offsets >= 0)
        out[k, usable] = _misfit(late[usable], window[usable])
    return out


def _misfit(t: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Root mean square (n,) in rad of what a polynomial leaves of windows of angles (n, m, k) at times (n, m)."""
    design = t[..., None] ** np.arange(ORDER + 1)
    q, _ = np.linalg.qr(design)
    rest = theta - q @ (np.swapaxes(q, 1, 2) @ theta)
    return np.sqrt((rest**2).sum((1, 2)) / (theta.shape[2] * (theta.shape[1] - ORDER - 1)))


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
        errors = np.rad2deg(self.error[between].max(axis=1))
        return (float(np.median(errors)), float(np.quantile(errors, 0.99))) if len(errors) else None


def resample(t: np.ndarray, place: np.ndarray, usable: np.ndarray, rate_hz: float) -> Resampled:
    """Interpolate the arms' angles and lengths by the cubic through four frames: a steady rotation stays one.

    Where many frames are missing, places are interpolated across single ones.  The error is that of the cubic's
    remainder, with the fourth derivative that each frame shows that is left out of the cubic through its neighbours;
    the markers' noise adds to it, so that it is rather too large.

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
    longest = interval * (OVER_ONE if (np.diff(t) > LONGEST * interval).mean() > MANY else LONGEST)
    rows = after[:, None] + np.arange(-POINTS // 2, POINTS // 2)
    inside = (rows[:, 0] >= 0) & (rows[:, -1] < len(t))
    rows = np.clip(rows, 0, len(t) - 1)
    near = (np.diff(t[rows], axis=1) < longest).all(1)
    between = inside & near & usable[rows].all(1) & ~kept
    weights = lagrange(t[rows[between]], even[between])
    arms = _arms(place)
    pivot, length, theta = (part[rows[between]] for part in arms)
    turned = theta[:, :1] + np.concatenate((np.zeros_like(theta[:, :1]), _cumulative(theta)), axis=1)
    at = [np.einsum("nm,nm...->n...", weights, part) for part in (pivot, length, turned)]
    out[between] = _places(*at)
    error = np.where(kept[:, None], 0.0, np.full((len(even), 2), np.nan))
    error[between] = _errors(t, np.where(usable[:, None], arms[2], np.nan), longest, even[between])
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


def lagrange(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Lagrange's weights (n, m) of nodes (n, m) at places (n,)."""
    weights = np.ones_like(nodes)
    for j in range(nodes.shape[1]):
        for k in range(nodes.shape[1]):
            if k != j:
                weights[:, j] *= (at - nodes[:, k]) / (nodes[:, j] - nodes[:, k])
    return weights


def _errors(t: np.ndarray, theta: np.ndarray, longest: float, at: np.ndarray) -> np.ndarray:
    """Of both angles at the times ``at`` (m,), (m, 2) in rad; ``theta`` (n, 2) has NaN where a frame is not usable,
    ``longest`` is the longest interval in s that tells."""
    count = len(t) - POINTS
    if count < 1 or not len(at):
        return np.full((len(at), theta.shape[1]), np.nan)
    rows = np.arange(count)[:, None] + np.arange(POINTS + 1)
    turned = np.concatenate((np.zeros((count, 1, theta.shape[1])), np.cumsum(turns(theta)[rows[:, :-1]], axis=1)), 1)
    turned += 0 * theta[rows[:, :1]]
    others = [0, 1, 3, 4]
    nodes, middle = t[rows[:, others]], t[rows[:, 2]]
    left_out = turned[:, 2] - np.einsum("nm,nmk->nk", lagrange(nodes, middle), turned[:, others])
    bent = np.full(theta.shape, np.nan)  # the fourth derivative over 24
    bent[2:-2] = left_out / np.prod(middle[:, None] - nodes, axis=1)[:, None]
    bent[2:-2][(np.diff(t[rows], axis=1) > longest).any(1)] = np.nan
    # The cubic through the two frames on either side of a time.
    after = np.clip(np.searchsorted(t, at, side="right"), 2, len(t) - 2)
    span = np.prod(np.abs(at[:, None] - t[after[:, None] + np.arange(-2, 2)]), axis=1)
    # The larger of what the frames on either side show: in fast motion it changes from frame to frame.
    bent = np.fmax(np.abs(bent[after - 1]), np.abs(bent[after]))
    return bent * span[:, None]


def interpolate_arm(t: np.ndarray, vector: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An arm between its frames, by cubics through two on either side.

    Arguments:
        t: times (n,) in s of the frames, growing.
        vector: the arm's (n, 2) in px.
        at: times (m,) in s.

    Returns:
        angle in rad, length in px and the angle's estimated error in rad, (m,) each; NaN where two frames on either
        side are not near enough.
    """
    interval = float(np.median(np.diff(t)))
    after = np.clip(np.searchsorted(t, at, side="right"), POINTS // 2, len(t) - POINTS // 2)
    rows = after[:, None] + np.arange(-POINTS // 2, POINTS // 2)
    theta, length = np.arctan2(vector[:, 0], vector[:, 1])[:, None], np.linalg.norm(vector, axis=1)
    part = theta[rows]
    turned = part[:, :1] + np.concatenate((np.zeros_like(part[:, :1]), _cumulative(part)), axis=1)
    weights = lagrange(t[rows], at)
    near = (np.diff(t[rows], axis=1) < OVER_ONE * interval).all(1)
    near &= (at > t[rows[:, 0]] - interval / 2) & (at < t[rows[:, -1]] + interval / 2)
    made = [np.where(near, (weights * values).sum(1), np.nan) for values in (turned[..., 0], length[rows])]
    return made[0], made[1], _errors(t, theta, OVER_ONE * interval, at)[:, 0]


def from_polar(theta: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Vectors (n, 2) of angles in rad, 0 where y grows, and lengths."""
    return length[:, None] * np.stack((np.sin(theta), np.cos(theta)), axis=1)
