"""Value objects that every stage shares."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.files import atomic, read_npz

OPTIONAL = ("id", "u", "mask", "noise")
STEP_SHARE = 1e-3  # of a step: times that are nearer are the same


def brief(t: np.ndarray) -> str:
    """Times in s, (T,), in short."""
    if len(t) < 4:
        return f"{', '.join(f'{v:.6g}' for v in t)} s"
    return f"{t[0]:.6g}, {t[1]:.6g} … {t[-1]:.6g} s ({len(t)} points)"


@dataclass(frozen=True)
class Trajectories:
    """A set of N trajectories of one system on common times; checked once, when made.

    Attributes:
        t: times in seconds, (T,), strictly increasing, float64.
        y: states, (N, T, *state), float32, finite; 0 where nothing was measured.
        z_e: expert parameters, (N, P), float32; NaN where one is not known, as of measured data.
        z_a: true interaction latent where it is known, (N, Q), float32; Q = 0 where it is not.
        u: known inputs on the same times, (N, T, U), float32, finite; None for a system without.
        id: where each sample comes from, (N,) texts: ``recording/first frame`` of a chunk; None where nobody asks.
        mask: which values of y were measured, (N, T, *state), bool; None where all are, and ever will be.
        noise: standard deviation of the noise of each component of a state, (K,), where it was estimated from the data.

    Raises:
        InputError: an array has the wrong number of axes, sizes disagree or a value is not finite.
    """

    t: np.ndarray
    y: np.ndarray
    z_e: np.ndarray
    z_a: np.ndarray = field(default=None)  # type: ignore[assignment]
    id: np.ndarray | None = None
    mask: np.ndarray | None = None
    noise: np.ndarray | None = None
    u: np.ndarray | None = None

    def __repr__(self) -> str:
        """In one line, whatever the size."""
        known = "" if self.u is None else f", {self.u.shape[2]} known inputs"
        seen = "" if self.mask is None else f", {100 * self.mask.mean():.3g} % measured"
        shape = "×".join(map(str, self.y.shape[2:]))
        return f"Trajectories({len(self)} of {brief(self.t)}, states of {shape} numbers{known}{seen})"

    def __post_init__(self) -> None:
        if self.z_a is None:
            object.__setattr__(self, "z_a", np.zeros((len(self.y), 0)))
        for name, dtype in (("t", np.float64), ("y", np.float32), ("z_e", np.float32), ("z_a", np.float32)):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=dtype))
        if self.t.ndim != 1 or np.any(np.diff(self.t) <= 0):
            raise InputError("trajectories", f"t has shape {self.t.shape}", "t must be strictly increasing, (T,)")
        if self.y.ndim < 3 or self.y.shape[1] != len(self.t):
            raise InputError(
                "trajectories", f"y has shape {self.y.shape} for {len(self.t)} times", "y is (N, T, *state)"
            )
        for name in ("z_e", "z_a"):
            value = getattr(self, name)
            if value.ndim != 2 or len(value) != len(self.y):
                raise InputError(
                    "trajectories", f"{name} has shape {value.shape} for {len(self.y)} samples", f"{name} is (N, P)"
                )
        if self.id is not None:
            object.__setattr__(self, "id", np.asarray(self.id))
            if self.id.shape != (len(self.y),) or self.id.dtype.kind != "U":
                problem = f"id has shape {self.id.shape} and type {self.id.dtype} for {len(self.y)} samples"
                raise InputError("trajectories", problem, "id is (N,), texts")
        self._check_measured()
        if self.u is not None:
            object.__setattr__(self, "u", np.ascontiguousarray(self.u, dtype=np.float32))
            if self.u.ndim != 3 or self.u.shape[:2] != self.y.shape[:2] or not self.u.shape[2]:
                problem = f"u has shape {self.u.shape} for {len(self.y)} samples at {len(self.t)} times"
                raise InputError("trajectories", problem, "u is (N, T, U), known inputs at the times of y")
        for name in ("t", "y", "z_e", "z_a", *(("u",) if self.u is not None else ())):
            value = getattr(self, name)
            bad = np.isinf(value) if name == "z_e" else ~np.isfinite(value)
            if bad.any():
                where = tuple(int(i) for i in np.argwhere(bad)[0])
                raise InputError(
                    "trajectories", f"{name} is not finite, first at index {where}", "every value must be finite"
                )

    def _check_measured(self) -> None:
        """The mask and the noise, in their types; values that were not measured become 0."""
        if self.noise is not None:
            noise = np.ascontiguousarray(self.noise, dtype=np.float64)
            object.__setattr__(self, "noise", noise)
            if noise.shape != self.y.shape[2:3] or not (np.isfinite(noise) & (noise >= 0)).all():
                problem = f"noise has shape {noise.shape} for states of shape {self.y.shape[2:]}"
                raise InputError("trajectories", problem, "noise is (K,), one number of 0 or more a component")
        if self.mask is None:
            return
        mask = np.asarray(self.mask)
        if mask.shape != self.y.shape or mask.dtype != bool:
            problem = f"mask has shape {mask.shape} and type {mask.dtype} for y of shape {self.y.shape}"
            raise InputError("trajectories", problem, "mask is (N, T, *state), bool: True where y was measured")
        object.__setattr__(self, "mask", np.ascontiguousarray(mask))
        object.__setattr__(self, "y", np.where(mask, self.y, np.float32(0)))

    def __len__(self) -> int:
        return len(self.y)

    @property
    def seen(self) -> np.ndarray:
        """The states with NaN where nothing was measured, (N, T, *state): what models and losses are given."""
        return self.y if self.mask is None else np.where(self.mask, self.y, np.float32(np.nan))

    @property
    def trajectories(self) -> np.ndarray | None:
        """Names of the trajectories that samples are windows of, (N,) texts; None where nobody knows."""
        if self.id is None:
            return None
        return np.array([trajectory_of(sample_id)[0] for sample_id in self.id.tolist()], dtype=str)

    def subset(self, index: slice | np.ndarray) -> Trajectories:
        """The samples that ``index`` (a slice, a mask or integers along N) selects."""
        several = {name: None if (v := getattr(self, name)) is None else v[index] for name in ("id", "u", "mask")}
        return replace(self, y=self.y[index], z_e=self.z_e[index], z_a=self.z_a[index], **several)

    def spread(self, count: int | None) -> Trajectories:
        """At most ``count`` samples, evenly spread; None = all."""
        if count is None or count >= len(self):
            return self
        return self.subset(np.linspace(0, len(self) - 1, count).astype(int))

    def with_parameters(self, z_e: Sequence[str], z_a: Sequence[str], wanted: Sequence[str]) -> Trajectories:
        """The same with other expert parameters: of another expert, which knows more or less of what made the data.

        Arguments:
            z_e, z_a: names of this set's parameters.
            wanted: names of the expert parameters; what is neither in z_e nor in z_a is not known (NaN).
        """
        columns = dict(zip((*z_e, *z_a), (*self.z_e.T, *self.z_a.T), strict=False))
        unknown = np.full(len(self), np.nan)
        return replace(self, z_e=np.stack([columns.get(name, unknown) for name in wanted], axis=1))

    def window(self, start: int, stop: int) -> Trajectories:
        """The points ``start`` to ``stop`` (not included) along time."""
        several = {name: None if (v := getattr(self, name)) is None else v[:, start:stop] for name in ("u", "mask")}
        return replace(self, t=self.t[start:stop], y=self.y[:, start:stop], **several)

    def save(self, path: str | Path) -> None:
        """Write an npz without pickle, atomically; not compressed: noise takes long to unpack and hardly less space."""
        with atomic(path) as temporary, temporary.open("wb") as stream:
            optional = {name: value for name in OPTIONAL if (value := getattr(self, name)) is not None}
            np.savez(stream, t=self.t, y=self.y, z_e=self.z_e, z_a=self.z_a, **optional)  # type: ignore

    @classmethod
    def load(cls, path: str | Path) -> Trajectories:
        """Read what :meth:`save` wrote.

        Raises:
            InputError: the file is missing, is no npz, lacks an array or holds no trajectories.
        """
        remedy = "make it again with its stage"
        arrays = read_npz(path, "trajectory file", remedy, ("t", "y", "z_e", "z_a"), optional=OPTIONAL)
        try:
            return cls(**arrays)
        except (InputError, TypeError, ValueError) as error:
            raise InputError(path, f"not a trajectory file ({error})", remedy) from error


class SetFolder(Mapping[str, Trajectories]):
    """The sets in a folder by name. Each is read when it is asked for and not kept: what goes through them one after
    the other needs the memory of one.

    Arguments:
        folder: with a file ``<name>.npz`` of each.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)

    def __getitem__(self, name: str) -> Trajectories:
        """Read a set.

        Raises:
            InputError: as of :meth:`Trajectories.load`.
        """
        return Trajectories.load(self.folder / f"{name}.npz")

    def __contains__(self, name: object) -> bool:
        return (self.folder / f"{name}.npz").is_file()

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(path.stem for path in self.folder.glob("*.npz")))

    def __len__(self) -> int:
        return len(list(iter(self)))


def points_until(t: Sequence[float] | np.ndarray, end: float) -> int:
    """Number of the times ``t`` (T,) up to ``end``, which is included, to a thousandth of the step there: a time that
    went through single precision is not lost."""
    times = np.asarray(t, dtype=float)
    step = float(np.diff(times).min()) if len(times) > 1 else 0.0
    return int((times <= end + 1e-9 + STEP_SHARE * step).sum())


def trajectory_of(identity: str) -> tuple[str, int]:
    """The trajectory that a window ``trajectory/first row`` is of, and the row; of another name the name, and 0."""
    head, _, tail = identity.rpartition("/")
    return (head, int(tail)) if head and tail.isdigit() else (identity, 0)


def places_by_trajectory(identity: np.ndarray | None, count: int) -> dict[str, np.ndarray]:
    """Places of each trajectory's windows in the order of their times; of windows without identities of each its own.

    Arguments:
        identity: ``trajectory/first row`` of each window, (N,); of others, which name a trajectory, the order is taken.
    """
    if identity is None:
        return {str(k): np.array([k]) for k in range(count)}
    names, rows = zip(*map(trajectory_of, map(str, identity)), strict=True) if count else ((), ())
    ordered = sorted(range(count), key=lambda k: rows[k])
    return {name: np.array([k for k in ordered if names[k] == name]) for name in dict.fromkeys(names)}
