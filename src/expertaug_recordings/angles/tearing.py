"""Torn frames: the picture above a row is of another time than below it, as in a capture without vertical sync.

Both arms are interpolated between the frames around.  A frame of another time is off that by one shift in time for both
markers, however it came about (repeated, missing, blended, jittered); in a torn one the shifts of joint and tip differ.
Where every frame is torn the frames around are no guide, but the second arm tells: the distance between the joint of a
frame and the tip of the next is that arm's length, the distance within a frame is not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from expertaug_recordings.angles.even_times import lagrange

SHIFTS = np.linspace(-1.25, 1.25, 21)  # of time, in frames, that are tried; ways between them are straight
LOCAL = 21  # frames over whose median a misfit is usual
STRANGE, WHOLE = 6.0, 3.0  # usual misfits from which on a frame is torn; where one marker is a whole frame off
LEAST = 0.003  # of both arms' length, below which a misfit does no harm
EXPLAINED = 0.25  # of a misfit that separate shifts leave at most
APART, A_FRAME = 0.2, 0.15  # least difference of the shifts, and by how much a shift may be off a whole frame
OFF, FITS = 6.0, 0.1  # noises by which an arm's length is off, and share of that by which the one across frames may be
MOSTLY = 0.5  # share of the frames of a stretch that the tracker doubts, from which on these are torn
PASSES = 8
FEWEST = 12  # frames


def find_torn(t: np.ndarray, place: np.ndarray, usable: np.ndarray, judged: np.ndarray) -> np.ndarray:
    """Frames (n,) whose joint and tip are of different times.

    Arguments:
        t: times (n,) in s, growing.
        place: pivot, joint and tip (n, 3, 2) in px; NaN where one was not found.
        usable: (n,), frames whose markers are trusted.
        judged: (n,), frames that may be torn.
    """
    arms = _arms(place, usable)
    torn = np.zeros(len(t), dtype=bool)
    for _ in range(PASSES):
        rows = np.flatnonzero(usable & ~torn)
        if len(rows) < FEWEST:
            break
        new = _strange(t, arms, rows, np.flatnonzero(judged & ~torn & np.isfinite(arms.joint + arms.tip).all(1)))
        if not len(new):
            break
        torn[new] = True
    torn |= _across(arms, usable) & judged
    # What another thing was taken for a marker in goes on for a while; of such frames few look torn by chance.
    doubted = judged & ~usable
    run = np.cumsum(np.diff(doubted, prepend=False))
    share = np.bincount(run, torn) / np.maximum(np.bincount(run), 1)
    return torn & (usable | (share[run] >= MOSTLY))


@dataclass(frozen=True)
class _Arms:
    """Joint and tip (n, 2) from the pivot in px, and the arms' angles (n, 2) in rad and lengths (n, 2) in px."""

    joint: np.ndarray
    tip: np.ndarray
    theta: np.ndarray
    length: np.ndarray


def _arms(place: np.ndarray, usable: np.ndarray) -> _Arms:
    # From the pivot's median: a single frame in which another thing is taken for it must not look like motion.
    pivot = np.nanmedian(place[usable, 0], axis=0) if usable.any() else np.zeros(2)
    joint, tip = place[:, 1] - pivot, place[:, 2] - pivot
    vector = np.stack((joint, tip - joint), axis=1)
    return _Arms(joint, tip, np.arctan2(vector[..., 0], vector[..., 1]), np.linalg.norm(vector, axis=2))


def _strange(t: np.ndarray, arms: _Arms, rows: np.ndarray, judged: np.ndarray) -> np.ndarray:
    """Numbers of frames whose markers are off the others' motion by different times, each further than those near it.

    Arguments:
        rows, judged: numbers of the frames that are used, and of those that are judged.
    """
    before = np.searchsorted(rows, judged)
    after = np.searchsorted(rows, judged, side="right")
    inside = (before >= 2) & (after <= len(rows) - 2)
    judged, before, after = judged[inside], before[inside], after[inside]
    nodes = rows[np.stack((before - 2, before - 1, after, after + 1), axis=1)]
    near = (nodes[:, 0] >= judged - 3) & (nodes[:, 3] <= judged + 3) & (judged > 0) & (judged < len(t) - 1)
    judged, nodes = judged[near], nodes[near]
    if len(judged) < FEWEST:
        return judged[:0]
    both = np.concatenate((arms.joint, arms.tip), axis=1)
    off = np.linalg.norm(_at(t, arms, nodes, t[judged]) - both[judged], axis=1)
    usual = np.maximum(median_filter(off, LOCAL), np.median(off))
    least = LEAST * float(np.median(arms.length[rows].sum(1)))
    further = off >= np.array([off[max(0, k - 2) : k + 3].max() for k in range(len(off))])
    chosen = np.flatnonzero((off > WHOLE * usual) & (off > least) & further)
    judged, nodes, usual = judged[chosen], nodes[chosen], usual[chosen]
    shifted = np.where(SHIFTS[:, None] < 0, t[judged] - t[judged - 1], t[judged + 1] - t[judged]) * SHIFTS[:, None]
    ways = np.stack([_at(t, arms, nodes, t[judged] + late) for late in shifted], axis=1)
    together, _ = _nearest(ways, both[judged])
    apart = [_nearest(ways[..., part], both[judged][:, part]) for part in (slice(0, 2), slice(2, 4))]
    left = np.hypot(apart[0][0], apart[1][0])
    shift = np.abs(np.stack((apart[0][1], apart[1][1]), axis=1))
    whole = (shift.min(1) < A_FRAME) & (np.abs(shift.max(1) - 1) < A_FRAME)
    differ = np.abs(apart[0][1] - apart[1][1]) > APART
    strange = (together > np.where(whole, WHOLE, STRANGE) * usual) & (together > least)
    return judged[strange & differ & (left < EXPLAINED * together)]


def _at(t: np.ndarray, arms: _Arms, nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Joint and tip (m, 4) at times (m,), by cubics through four frames (m, 4) each."""
    theta = arms.theta[nodes]
    turned = np.cumsum(np.angle(np.exp(1j * np.diff(theta, axis=1, prepend=theta[:, :1]))), axis=1) + theta[:, :1]
    weights = lagrange(t[nodes], at)
    angle, length = (np.einsum("nm,nmk->nk", weights, values) for values in (turned, arms.length[nodes]))
    vector = length[..., None] * np.stack((np.sin(angle), np.cos(angle)), axis=-1)
    return np.cumsum(vector, axis=1).reshape(len(at), 4)


def _nearest(ways: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (m,) of points (m, d) from ways (m, len(SHIFTS), d), and the shifts (m,) at which they are nearest."""
    step = np.diff(ways, axis=1)
    part = ((point[:, None] - ways[:, :-1]) * step).sum(-1) / np.maximum((step**2).sum(-1), 1e-12)
    part = np.clip(part, 0, 1)
    away = np.linalg.norm(ways[:, :-1] + part[..., None] * step - point[:, None], axis=-1)
    best, every = away.argmin(1), np.arange(len(away))
    return away[every, best], SHIFTS[best] + part[every, best] * (SHIFTS[1] - SHIFTS[0])


def _across(arms: _Arms, usable: np.ndarray) -> np.ndarray:
    """Frames (n,) whose second arm has its length from the joint to the tip of a frame next to it only."""
    typical = float(np.median(arms.length[usable, 1])) if usable.any() else np.nan
    own = np.abs(arms.length[:, 1] - typical)
    other = np.full((len(own), 4), np.inf)
    for k, (joint, tip) in enumerate(((arms.joint, arms.tip), (arms.tip, arms.joint))):
        length = np.abs(np.linalg.norm(tip[1:] - joint[:-1], axis=1) - typical)
        other[1:, 2 * k], other[:-1, 2 * k + 1] = length, length
    other = np.where(np.isfinite(other), other, np.inf).min(1)
    with np.errstate(invalid="ignore"):
        noise = 1.4826 * float(np.median(own[usable])) if usable.any() else np.inf
        return (own > OFF * noise) & (own > LEAST * typical) & (other < FITS * own)
