"""Systems as users write them: a driven Duffing oscillator and a block with Coulomb friction."""

import torch

from expertaug.systems.base import Parameter, System
from expertaug.systems.solvers.solver import Solver


class Duffing(System):
    """x'' = F(t) / m − k x − b x³ − c x', with a known force and mass; c is hidden."""

    state = (Parameter("x", "m"), Parameter("v", "m/s"))
    expert_parameters = (Parameter("k", "1/s²"), Parameter("b", "1/(m s)²"))
    interaction_parameters = (Parameter("c", "1/s"),)
    inputs = (Parameter("force", "N", positive=False),)
    covariates = (Parameter("mass", "kg"),)
    input_parameters = (Parameter("A", "N"), Parameter("w", "rad/s"))

    def expert(self, t, y, z_e, u):
        (x, v), (k, b), (force, mass) = y.unbind(-1), z_e.unbind(-1), u.unbind(-1)
        return torch.stack((v, force / mass - k * x - b * x**3), dim=-1)

    def truth(self, t, y, z_e, z_a, u):
        drag = z_a[..., 0] * y[..., 1]
        return self.expert(t, y, z_e, u) - torch.stack((torch.zeros_like(drag), drag), dim=-1)

    def input_signal(self, t, parameters):
        amplitude, frequency = parameters.unsqueeze(1).unbind(-1)
        return (amplitude * torch.cos(frequency * t)).unsqueeze(-1)

    def sample_initial_state(self, n, generator):
        return 2 * torch.rand(n, 2, generator=generator, dtype=torch.float64) - 1


class Block(System):
    """A block on a spring with Coulomb friction: x'' = −k x − mu sign(x') − c x'; it may stick, and c is hidden."""

    state = (Parameter("x", "m"), Parameter("v", "m/s"))
    expert_parameters = (Parameter("k", "1/s²"), Parameter("mu", "m/s²"))
    interaction_parameters = (Parameter("c", "1/s"),)
    simulation = Solver("rk4", substeps=4)

    def expert(self, t, y, z_e, side):
        (x, v), (k, mu) = y.unbind(-1), z_e.unbind(-1)
        rates = torch.stack((v, -k * x - mu * side), dim=-1)
        return torch.where(side.unsqueeze(-1) == 0, 0.0, rates)

    def truth(self, t, y, z_e, z_a, side):
        drag = z_a[..., 0] * y[..., 1]
        return self.expert(t, y, z_e, side) - torch.stack((torch.zeros_like(drag), drag), dim=-1)

    def event(self, y, z_e):
        return y[..., 1]

    def jump(self, y, z_e):
        return torch.stack((y[..., 0], torch.zeros_like(y[..., 1])), dim=-1)

    def sample_initial_state(self, n, generator):
        x = 1 + torch.rand(n, generator=generator, dtype=torch.float64)
        return torch.stack((x, torch.zeros_like(x)), dim=-1)
