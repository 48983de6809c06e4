"""A camera that looks askew, told by the arms: what turns on a circle draws an ellipse in its image.

The lengths of both arms are the same in every direction and at every place of the plane of motion.  In the image, about
the pivot, a point x of that plane is seen where A x / (1 − g·x) is, A a stretch along two axes (oblique view from afar,
pixels that are not square) and g what is nearer to the camera and larger (oblique view from near).  Offsets of markers
from their hinges vary a length with the first harmonics of the angles, a stretch with the second
(:mod:`.offsets`), so that one is not taken for the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from expertaug_recordings.angles.noise import spread
from expertaug_recordings.angles.offsets import find_offsets

MOST = 1500  # frames or a little more, which tell enough
PASSES, TRIMMED = 4, 4.0  # robust standard deviations beyond which a frame is left out
NEARER = 0.9  # of the spread of the arms' lengths: perspective that does not lower it as far is left out
LEAST_ARC = 60.0  # degrees over which the first arm must turn, or the second
MOST_STRETCH = 2.0


@dataclass(frozen=True)
class View:
    """From the image to the plane of motion: about ``centre`` (x, y) in px, ``stretch`` (2, 2) symmetric with
    determinant 1, over 1 + ``nearer`` (2,) px⁻¹ times the place; ``spread`` are robust standard deviations of the arms'
    lengths as shares, (2,), before and after."""

    centre: np.ndarray
    stretch: np.ndarray
    nearer: np.ndarray
    spread: tuple[np.ndarray, np.ndarray]

    @property
    def matrix(self) -> np.ndarray:
        """The same as a homography (3, 3) of places in px."""
        to, back = np.eye(3), np.eye(3)
        to[:2, 2], back[:2, 2] = -self.centre, self.centre
        middle = np.eye(3)
        middle[:2, :2], middle[2, :2] = self.stretch, self.nearer
        return back @ middle @ to

    @property
    def gain(self) -> float:
        """By which factor the less steady arm becomes steadier."""
        before, after = self.spread
        return float(before.max() / max(after.max(), 1e-9))


def find_view(places: np.ndarray, usable: np.ndarray, offsets: bool) -> View | None:
    """The view by which the arms are steadiest; None where they turn too little to tell.

    Arguments:
        places: of pivot, joint and tip in px, (n, 3, 2); the pivot's are known in all frames.
        usable: (n,), frames that count.
        offsets: whether markers may be off their hinges.
    """
    seen = places[usable]
    seen = seen[:: max(1, len(seen) // MOST)]
    centre = np.median(seen[:, 0], axis=0)
    seen = seen - centre
    if max(_arc(np.diff(seen, axis=1)[:, k]) for k in (0, 1)) < LEAST_ARC:
        return None
    none = np.zeros(2)
    start = _steadiness(seen, offsets)
    stretch = _from_afar(np.diff(seen, axis=1))
    if stretch is None:
        return None
    afar = View(centre, stretch, none, (start, _steadiness(seen @ stretch, offsets)))
    stretch, nearer = _from_near(seen, stretch)
    near = View(centre, stretch, nearer, (start, _steadiness(_seen_from(seen, stretch, nearer), offsets)))
    return near if near.spread[1].max() < NEARER * afar.spread[1].max() else afar


def _seen_from(places: np.ndarray, stretch: np.ndarray, nearer: np.ndarray) -> np.ndarray:
    return places @ stretch / (1 + places @ nearer)[..., None]


def _steadiness(places: np.ndarray, offsets: bool) -> np.ndarray:
    """Spreads of the two lengths, as shares of them."""
    vectors = np.diff(places, axis=1)
    if offsets:
        vectors = find_offsets(vectors, np.ones(len(vectors), bool)).remove(vectors)
    length = np.linalg.norm(vectors, axis=-1)
    return spread(length) / np.median(length, axis=0)


def _arc(vectors: np.ndarray) -> float:
    """Degrees over which most of vectors (n, 2) turn, as lines: a stretch is the same in opposite directions."""
    angle = np.sort(np.rad2deg(np.arctan2(vectors[:, 0], vectors[:, 1])) % 180)
    return 180 - float(np.diff(np.append(angle, angle[0] + 180)).max())


def _from_afar(vectors: np.ndarray) -> np.ndarray | None:
    """Stretch by least squares of |v|² + p (x² − y²) + 2 q x y = l², l of either arm; None for an impossible one."""
    x, y = vectors[..., 0], vectors[..., 1]
    square = x**2 + y**2
    typical = np.median(square, axis=0)
    which = np.broadcast_to(np.eye(2), (len(vectors), 2, 2))
    design = np.concatenate((np.stack((x**2 - y**2, 2 * x * y), -1) / typical[:, None], -which), axis=-1).reshape(-1, 4)
    target = -(square / typical).ravel()
    used = np.ones(len(target), bool)
    for _ in range(PASSES):
        solution, *_ = np.linalg.lstsq(design[used], target[used], rcond=None)
        off = target - design @ solution
        used = np.abs(off) < TRIMMED * max(float(spread(off[used])), 1e-9)
    p, q = solution[:2]
    return _root(float(p), float(q))


def _root(p: float, q: float) -> np.ndarray | None:
    """The stretch whose square is [[1 + p, q], [q, 1 − p]], with determinant 1."""
    square = np.array([[1 + p, q], [q, 1 - p]])
    value, axis = np.linalg.eigh(square)
    if value[0] * MOST_STRETCH**2 < value[1]:
        return None
    root = (value / np.sqrt(value.prod())) ** 0.5
    return (axis * root) @ axis.T


def _from_near(places: np.ndarray, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stretch and perspective together, by robust least squares of the logarithms of the lengths."""
    size = float(np.median(np.linalg.norm(np.diff(places, axis=1), axis=-1)))
    square = stretch @ stretch
    square = square / (square.trace() / 2)
    first = [(square[0, 0] - square[1, 1]) / 2, square[0, 1], 0.0, 0.0]

    def lengths(x: np.ndarray) -> np.ndarray:
        root = _root(x[0], x[1])
        root = np.eye(2) if root is None else root
        below = np.maximum(1 + places @ x[2:4] / size, 0.1)
        return np.log(np.linalg.norm(np.diff(places @ root / below[..., None], axis=1), axis=-1))

    known = np.median(lengths(np.array(first)), axis=0)
    noise = max(float(np.max(spread(lengths(np.array(first))))), 1e-6)
    found = least_squares(
        lambda x: ((lengths(x) - x[4:]) / noise).ravel(), [*first, *known], loss="soft_l1", x_scale="jac", max_nfev=60
    ).x
    root = _root(found[0], found[1])
    return (stretch, np.zeros(2)) if root is None else (root, found[2:4] / size)
