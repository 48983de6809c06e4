"""The damped wave equation ∂²w/∂t² = c² Δw − k ∂w/∂t on a square (Yin et al. 2021, APHYNITY)."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import pad

from expertaug.errors import InputError
from expertaug.systems.base import Parameter, System

SIDE = 63.0  # of the square in m: the authors' 64 points are 1 m apart
CENTRES = (20, 40)  # in m, whole numbers, the last left out: where simulations have their peak
SPREADS = (10.0, 100.0)  # s of exp(−r²/s), in m²


class DampedWave(System):
    """State (w, ∂w/∂t), two fields (2, N, N); z_e = c, z_a = k; the expert lacks the damping.

    Δ is the five-point Laplacian.  At an edge there is no second difference across it, as in the authors' code (their
    paper calls the boundaries Neumann's), so that an edge at rest stays there and waves come back inverted.  They
    simulate by differences of fourth order and have an expert of second; here both are of second, so that the damping
    is all that the expert lacks.

    Arguments:
        cells: N, points along a side of the same square.
    """

    state = (Parameter("w"), Parameter("w_t", "1/s"))
    expert_parameters = (Parameter("c", "m/s", scale=300.0),)
    interaction_parameters = (Parameter("k", "1/s"),)
    periodic = False

    def __init__(self, cells: int = 64) -> None:
        if isinstance(cells, bool) or not isinstance(cells, int) or cells < 4:
            raise InputError("system.cells", repr(cells), "a whole number from 4 on")
        self.cells = cells

    @property
    def state_shape(self) -> tuple[int, ...]:
        return (2, self.cells, self.cells)

    @property
    def width(self) -> float:
        """Distance of neighbouring points in m."""
        return SIDE / (self.cells - 1)

    def laplacian(self, w: Tensor) -> Tensor:
        """Δw of w (…, N, N)."""
        return (pad(w.diff(n=2, dim=-1), (1, 1)) + pad(w.diff(n=2, dim=-2), (0, 0, 1, 1))) / self.width**2

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor) -> Tensor:
        w, speed = y.unbind(-3)
        return torch.stack((speed, z_e.square()[..., None] * self.laplacian(w)), dim=-3)

    def truth(self, t: Tensor, y: Tensor, z_e: Tensor, z_a: Tensor) -> Tensor:
        damping = z_a[..., None] * y[..., 1, :, :]
        return self.expert(t, y, z_e) - torch.stack((torch.zeros_like(damping), damping), dim=-3)

    def kinematics(self, y: Tensor) -> Tensor:
        return torch.stack((y[..., 1, :, :], torch.zeros_like(y[..., 1, :, :])), dim=-3)

    def sample_initial_state(self, n: int, generator: torch.Generator) -> Tensor:
        """A peak of height 1 at rest, exp(−r²/s), with its centre and s drawn uniformly."""
        centre = torch.randint(*CENTRES, (n, 2, 1), generator=generator).double()
        low, high = SPREADS
        spread = low + (high - low) * torch.rand(n, 1, generator=generator, dtype=torch.float64)
        x = torch.linspace(0, SIDE, self.cells, dtype=torch.float64)
        rows, columns = torch.exp(-(x - centre).square() / spread[..., None]).unbind(1)
        w = rows[:, :, None] * columns[:, None, :]
        return torch.stack((w, torch.zeros_like(w)), dim=1)
