"""Windows of trajectories as tensors: what was measured of samples, at which times, and with which known inputs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.trajectories import Trajectories

MANY = 2**26  # numbers, of which gaps are looked for point by point: a mask of all has a quarter of their bytes


@dataclass(frozen=True, eq=False)
class Windows:
    """Measured states of B samples at the first times, and what is known at all times: what estimates are made of, and
    forecasts of these.

    Its tensors are views of what it was made of wherever they can be.  Shapes and types are checked, values are not: a
    computation need not wait for a card that holds them (:meth:`of` takes them from checked trajectories).

    Attributes:
        t: times in s, (T,).
        y: states at the first T1 of these times, (T1, B, *state), or (T1, S, B, *state) for S seeds, where S may be 1
            for all seeds alike; NaN where nothing was measured.
        u: known inputs at all times, (T, B, U) or (T, S, B, U); None for a system without.
        trajectories: names of the trajectories that the samples are of, (B,); None where nobody knows.

    Raises:
        InputError: shapes disagree, or a tensor holds no floating-point numbers.
    """

    t: Tensor
    y: Tensor
    u: Tensor | None = None
    trajectories: np.ndarray | None = None

    def __post_init__(self) -> None:
        if not all(tensor.is_floating_point() for tensor in (self.t, self.y, *self._inputs)):
            actual = ", ".join(str(tensor.dtype) for tensor in (self.t, self.y, *self._inputs))
            raise InputError("windows", f"tensors of {actual}", "give floating-point numbers")
        if self.t.dim() != 1 or self.y.dim() < 3 or not 0 < len(self.y) <= len(self.t):
            actual = f"y has shape {tuple(self.y.shape)} for times of shape {tuple(self.t.shape)}"
            raise InputError("windows", actual, "y is (T1, …, B, *state) at the first of the times (T,)")
        if self.u is not None:
            lead = tuple(self.u.shape[1:-1])
            if self.u.dim() < 3 or len(self.u) != len(self.t) or lead != tuple(self.y.shape[1 : 1 + len(lead)]):
                actual = f"u has shape {tuple(self.u.shape)} for y of shape {tuple(self.y.shape)}"
                raise InputError("windows", actual, f"u is ({len(self.t)}, …, B, U), known inputs of the same samples")

    @classmethod
    def of(cls, data: Trajectories, device: torch.device | str = "cpu") -> Windows:
        """A set of N trajectories, seen at all its times and shared by all seeds: y (T, 1, N, *state)."""
        y = torch.from_numpy(np.ascontiguousarray(np.moveaxis(data.seen, 1, 0))).unsqueeze(1).to(device)
        u = None if data.u is None else torch.from_numpy(data.u).movedim(1, 0).contiguous().unsqueeze(1).to(device)
        return cls(torch.from_numpy(data.t).float(), y, u, data.trajectories)

    @staticmethod
    def cat(parts: Sequence[Windows]) -> Windows:
        """Samples of several groups' windows (T1, S, B, *state) at the same times, one after the other."""
        inputs = [part.u for part in parts if part.u is not None]
        u = torch.cat(inputs, dim=2) if len(inputs) == len(parts) else None
        names = [part.trajectories for part in parts if part.trajectories is not None]
        of = np.concatenate(names) if len(names) == len(parts) else None
        return Windows(parts[0].t, torch.cat([part.y for part in parts], dim=2), u, of)

    @property
    def points(self) -> int:
        """T1, at how many times the states are known."""
        return len(self.y)

    @property
    def numbers(self) -> int:
        """How many numbers :attr:`joined` has of one sample of a group's windows (T1, S, B, *state) at one time."""
        inputs = 0 if self.u is None else self.u.shape[-1] * self.y.shape[4:].numel()
        return self.y.shape[3:].numel() + inputs

    @property
    def measured(self) -> Tensor:
        """Which values of y were measured, in its shape."""
        return ~torch.isnan(self.y)

    @property
    def has_gaps(self) -> bool:
        """Whether some value was not measured."""
        parts = [self.y] if self.y.numel() < MANY else self.y
        return any(bool(torch.isnan(part).any()) for part in parts)

    @property
    def joined(self) -> Tensor:
        """What an encoder sees, (T1, …, B, *observed): the states, with the known inputs as further components, the
        same all over a field; the states themselves where there are no inputs."""
        if self.u is None:
            return self.y
        u = self.u[: self.points]
        wide = u.to(self.y.dtype)[(..., *[None] * (self.y.dim() - u.dim()))]
        axis = u.dim() - 1
        return torch.cat((self.y, wide.expand(*u.shape, *self.y.shape[axis + 1 :])), dim=axis)

    def until(self, points: int) -> Windows:
        """The first times alone, with the states and the inputs then."""
        u = None if self.u is None else self.u[:points]
        return replace(self, t=self.t[:points], y=self.y[:points], u=u)

    def observed(self, points: int) -> Windows:
        """The states at the first times alone; the other times, and the inputs then, stay known."""
        return replace(self, y=self.y[:points])

    def samples(self, index: slice | Tensor) -> Windows:
        """Some samples of a group's windows (T1, S, B, *state)."""
        u = None if self.u is None else self.u[:, :, index]
        of = self.trajectories
        if of is not None:
            of = of[index.cpu().numpy() if isinstance(index, Tensor) else index]
        return Windows(self.t, self.y[:, :, index], u, of)

    def split(self, size: int) -> Iterator[Windows]:
        """Parts of at most so many samples of a group's windows (T1, S, B, *state)."""
        return (self.samples(slice(k, k + size)) for k in range(0, self.y.shape[2], size))

    def seed(self, place: int | slice) -> Windows:
        """One seed's windows (T1, B, *state) of a group's, or those of several, (T1, S', B, *state)."""
        return replace(self, y=self.y[:, place], u=None if self.u is None else self.u[:, place])

    def expand(self, seeds: int) -> Windows:
        """Windows (T1, 1, B, *state) that S seeds share, as those of each: (T1, S, B, *state), without a copy."""
        y = self.y.expand(-1, seeds, *self.y.shape[2:])
        return replace(self, y=y, u=None if self.u is None else self.u.expand(-1, seeds, *self.u.shape[2:]))

    def at(self, seeds: Tensor, samples: Tensor) -> Windows:
        """Samples of each seed by places (S, B') of a group's windows: those of seed ``seeds[s, b]``."""
        return Windows(self.t, self.y[:, seeds, samples], None if self.u is None else self.u[:, seeds, samples])

    def contiguous(self) -> Windows:
        """The same, each tensor in one piece of memory."""
        return replace(self, y=self.y.contiguous(), u=None if self.u is None else self.u.contiguous())

    def with_seeds(self) -> Windows:
        """Windows (T1, B, *state) as those that all seeds share, (T1, 1, B, *state)."""
        return replace(self, y=self.y.unsqueeze(1), u=None if self.u is None else self.u.unsqueeze(1))

    def filled(self, times: Tensor, middle: Tensor) -> Windows:
        """The same with straight lines over gaps (:func:`fill`), itself where there are none."""
        y = fill(self.y, times, middle)
        return self if y is self.y else replace(self, y=y)

    @property
    def _inputs(self) -> tuple[Tensor, ...]:
        return () if self.u is None else (self.u,)


def fill(observed: Tensor, times: Tensor, middle: Tensor) -> Tensor:
    """States over time with straight lines over their gaps (NaN), constant before the first measured value and after
    the last; the same tensor where there are none.

    Arguments:
        observed: (T1, …, B, K), or (T1, …, B, K + U) with known inputs, which have no gaps, after the states.
        times: in s, (T1,).
        middle: what a component without a measured value is, (K,).
    """
    if not torch.isnan(observed).any():
        return observed
    observed, inputs = observed.tensor_split([len(middle)], dim=-1)
    measured = ~torch.isnan(observed)
    last = len(observed) - 1
    place = torch.arange(len(observed), device=observed.device).view(-1, *[1] * (observed.dim() - 1))
    before = torch.where(measured, place, -1).cummax(0).values
    after = torch.where(measured, place, last + 1).flip(0).cummin(0).values.flip(0)
    left = torch.where(before >= 0, before, after.clamp_max(last))
    right = torch.where(after <= last, after, before.clamp_min(0))
    times, values = times.to(observed), observed.nan_to_num()
    start, end = values.gather(0, left), values.gather(0, right)
    share = (times[place] - times[left]) / (times[right] - times[left]).clamp_min(1e-12)
    lines = torch.where(right > left, start + (end - start) * share, start)
    filled = torch.where(measured, observed, torch.where(measured.any(0), lines, middle))
    return torch.cat((filled, inputs), dim=-1) if inputs.shape[-1] else filled
