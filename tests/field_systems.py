"""A field of one dimension, as a user writes its system: Fisher's equation, of which the expert knows the diffusion."""

import torch

from expertaug.systems import Parameter, System

CELLS, LENGTH = 64, 2.0


class Fisher(System):
    """du/dt = D u_xx + r u (1 − u) on a ring of 64 cells; z_e = D, and r is hidden."""

    state = (Parameter("u"),)
    expert_parameters = (Parameter("D", "1/s", scale=2e-3),)
    interaction_parameters = (Parameter("r", "1/s"),)

    @property
    def state_shape(self):
        return (1, CELLS)

    def expert(self, t, y, z_e):
        return z_e[..., None] * (y.roll(1, -1) + y.roll(-1, -1) - 2 * y) / (LENGTH / CELLS) ** 2

    def truth(self, t, y, z_e, z_a):
        return self.expert(t, y, z_e) + z_a[..., None] * y * (1 - y)

    def sample_initial_state(self, n, generator):
        x = torch.arange(CELLS, dtype=torch.float64) * 2 * torch.pi / CELLS
        phase = 2 * torch.pi * torch.rand(n, 1, 1, generator=generator, dtype=torch.float64)
        sharp = 1 + 4 * torch.rand(n, 1, 1, generator=generator, dtype=torch.float64)
        return 0.6 * torch.exp(sharp * (torch.cos(x - phase) - 1))
