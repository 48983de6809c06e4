"""Markers that are not where the hinges are: how far off, told by how the arms' lengths vary.

With e(θ) and n(θ) along and across an arm, the vectors between the markers are

    v1 = l1 e(θ1) + p + m1 + m2        v2 = l2 e(θ2) − m1 − m2 + g,

p by how much the pivot's marker is off (fixed in the image), m1 = a e(θ1) + b n(θ1) and m2 = c e(θ2) + d n(θ2) the
joint's marker off its hinge on the first or on the second arm, and g what is fixed in the image at the second arm.
Markers in planes of different distance from the camera look like that too: the second arm then gets a share of the
first.  Of m1 the first arm's length tells nothing, but the second's varies with cos(θ2 − θ1) and sin(θ2 − θ1); of m2
the first's does; and p and g vary the lengths with the direction of their own arm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from expertaug_recordings.angles.noise import TRIMMED, spread

MOST = 5000  # frames or a little more, which tell enough
PASSES = 4
CERTAIN = 10.0  # standard errors of white noise; those of correlated noise are about a third as certain
WILD = 0.3  # of an arm's length, by which no offset changes it
GROUPS = ("pivot", "joint_arm2", "joint_arm1", "tip")  # two of each arm's length: first p, m2, then m1, g


@dataclass(frozen=True)
class Offsets:
    """Offsets in px, (2,) each and 0 where there is none that the lengths tell for certain.

    Attributes:
        pivot, tip: (x, y) in the image.
        joint_arm1, joint_arm2: of the joint's marker from its hinge, along and across the arm on which it sits.
    """

    pivot: np.ndarray
    joint_arm1: np.ndarray
    joint_arm2: np.ndarray
    tip: np.ndarray

    @property
    def sizes(self) -> dict[str, float]:
        """In px, of those that are not 0."""
        sizes = {name: float(np.hypot(*getattr(self, name))) for name in GROUPS}
        return {name: size for name, size in sizes.items() if size > 0}

    def remove(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (n, 2, 2) between hinges, of those between markers."""
        true = vectors
        for _ in range(PASSES):  # the offsets turn with the true angles
            first, second = (_axes(true[:, k]) for k in (0, 1))
            joint = np.einsum("nij,i->nj", first, self.joint_arm1) + np.einsum("nij,i->nj", second, self.joint_arm2)
            true = np.stack((vectors[:, 0] - self.pivot - joint, vectors[:, 1] + joint - self.tip), axis=1)
        return true


NONE = Offsets(*np.zeros((4, 2)))


def find_offsets(vectors: np.ndarray, usable: np.ndarray) -> Offsets:
    """Offsets by robust least squares of the arms' squared lengths.

    Arguments:
        vectors: between the markers in px, (n, 2, 2).
        usable: (n,), frames that count.
    """
    found = dict.fromkeys(GROUPS, np.zeros(2))
    seen = vectors[usable]
    seen = seen[:: max(1, len(seen) // MOST)]
    for _ in range(PASSES):
        true = Offsets(**found).remove(seen)
        step = {}
        for k in (0, 1):
            step |= _harmonics(true, k, found)
        found = {name: found[name] + step[name] for name in GROUPS}
    return Offsets(**found)


def _axes(vectors: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 2, 2) along and across vectors (n, 2)."""
    along = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
    return np.stack((along, np.stack((-along[:, 1], along[:, 0]), axis=-1)), axis=1)


def _harmonics(vectors: np.ndarray, k: int, found: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Changes of the two offsets that arm k's length tells of; 0 for one that is not certain, or smaller than the
    lengths' noise."""
    own, other = _axes(vectors[:, k])[:, 0], _axes(vectors[:, 1 - k])
    length = np.linalg.norm(vectors[:, k], axis=-1)
    # |l e + o|² = l² + 2 l e·o + ..., for an offset o that is fixed in the image, or turns with the other arm
    sign = 1.0 if k == 0 else -1.0
    columns = [np.einsum("nj,nij->ni", own, other) * sign, own]
    design = np.concatenate((np.ones((len(own), 1)), *columns), axis=1)
    typical = float(np.median(length))
    target = (length**2 - typical**2) / (2 * typical)
    used = np.abs(target) < WILD * typical
    for _ in range(PASSES):
        x, *_ = np.linalg.lstsq(design[used], target[used], rcond=None)
        off = target - design @ x
        noise = max(float(spread(off[used])), 1e-9)
        used = np.abs(off) < TRIMMED * noise
    inverse = np.linalg.pinv(design[used].T @ design[used], hermitian=True)
    names = ("joint_arm2", "pivot") if k == 0 else ("joint_arm1", "tip")
    change = {}
    for name, first in zip(names, (1, 3), strict=True):
        error = noise * np.sqrt(np.trace(inverse[first : first + 2, first : first + 2]))
        total = found[name] + x[first : first + 2]
        sure = np.hypot(*total) > max(CERTAIN * error, noise)
        change[name] = x[first : first + 2] if sure else -found[name]
    return change
