"""Solving dy/dt = f(t, y) with torchdiffeq: on the data's own grid, or to a tolerance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor
from torchdiffeq import odeint

from expertaug.errors import InputError, SolveError

FIXED = ("euler", "midpoint", "rk4")


@dataclass(frozen=True)
class Solver:
    """How to solve.

    Attributes:
        method: a fixed-grid method or an adaptive one of torchdiffeq.
        rtol, atol: tolerances of an adaptive method; unused on a fixed grid.
        substeps: steps of a fixed-grid method from data time to data time.
    """

    method: str = "rk4"
    rtol: float = 1e-6
    atol: float = 1e-6
    substeps: int = 1

    def __post_init__(self) -> None:
        if self.method not in (*FIXED, "dopri5", "dopri8"):
            raise InputError("solver.method", repr(self.method), f"one of {', '.join(FIXED)}, dopri5, dopri8")

    @classmethod
    def from_mapping(cls, settings: Mapping[str, object]) -> Solver:
        """Build from a config slice; unknown keys raise :class:`InputError`."""
        for key in settings:
            if key not in cls.__dataclass_fields__:
                raise InputError(f"solver.{key}", "unknown", f"known: {', '.join(cls.__dataclass_fields__)}")
        return cls(**settings)  # type: ignore[arg-type]

    def __call__(self, f: Callable[[Tensor, Tensor], Tensor], y0: Tensor, t: Tensor) -> Tensor:
        """States (T, *y0.shape) at the times t (T,), the first being y0."""
        if self.method in FIXED:
            if self.substeps == 1:
                return odeint(f, y0, t, method=self.method)
            share = torch.arange(self.substeps).to(t) / self.substeps
            fine = (t[:-1, None] + t.diff()[:, None] * share).flatten()
            return odeint(f, y0, torch.cat((fine, t[-1:])), method=self.method)[:: self.substeps]
        try:
            return odeint(f, y0, t, method=self.method, rtol=self.rtol, atol=self.atol)
        except AssertionError as error:  # torchdiffeq's word for a step that underflowed
            raise SolveError(f"{self.method} failed ({error})") from error


def check_finite(y: Tensor, z_e: Tensor, what: str) -> None:
    """Name the first trajectory that is not finite.

    Arguments:
        y: (T, …, *state) with as many axes between as z_e has before its last.
        z_e: (…, P).
        what: system, method or seed, for the message.

    Raises:
        SolveError: a value is NaN or infinite; the message names the sample and its parameters.
    """
    if torch.isfinite(y).all():
        return
    lead = z_e.dim() - 1
    bad = ~torch.isfinite(y).movedim(0, -1).flatten(lead).all(-1)
    index = tuple(bad.nonzero()[0].tolist())
    values = ", ".join(f"{v:.4g}" for v in z_e[index].tolist())
    raise SolveError(
        f"{what}: {int(bad.sum())} trajectories are not finite, the first at index {index} with parameters ({values}); "
        "narrow the parameter range or lower solver.rtol"
    )
