"""Encoders, interaction models and an objective as a user writes them: ordinary PyTorch."""

import torch
from torch import nn

from expertaug.learning.objectives import Aphynity
from expertaug.models.interactions.base import Interaction
from expertaug.models.posterior import Gaussian, Posterior


class LinearEncoder(nn.Module):
    """Returns unbounded z_e and z_a."""

    latent = 2
    head_prefix = "head."

    def __init__(self, system, times, width=8):
        super().__init__()
        inputs = len(times) * len(system.state)
        self.trunk = nn.Sequential(nn.Linear(inputs, width), nn.LayerNorm(width), nn.Tanh())
        self.head = nn.Linear(width, len(system.expert_parameters))
        self.latent_head = nn.Linear(width, self.latent)

    def forward(self, observed):
        hidden = self.trunk(observed.movedim(0, 1).flatten(1))
        return self.head(hidden), self.latent_head(hidden)


class InheritedEncoder(LinearEncoder):
    """Its constructor is its parent's."""

    latent = 0

    def forward(self, observed):
        return super().forward(observed)[0]


class KeywordEncoder(LinearEncoder):
    """Hands on what it does not know; learns scales before training."""

    def __init__(self, *, gain=1.0, **options):
        super().__init__(**options)
        self.gain = gain
        self.register_buffer("size", torch.ones(()))

    def fit(self, observed):
        self.size = observed.std()

    def forward(self, observed):
        return super().forward(self.gain * observed / self.size)


class GRUEncoder(nn.Module):
    """torch's own GRU, which vmap has no rule for."""

    latent = 4

    def __init__(self, system):
        super().__init__()
        self.gru = nn.GRU(len(system.state), self.latent)
        self.head = nn.Linear(self.latent, len(system.expert_parameters))

    def forward(self, observed):
        hidden = self.gru(observed)[1][0]
        return self.head(hidden), hidden


class GaussianEncoder(LinearEncoder):
    """Returns a posterior of Gaussians."""

    def __init__(self, system, times, width=8):
        super().__init__(system, times, width)
        self.parameters_of_system = system.expert_parameters
        self.spread = nn.Parameter(torch.tensor(-2.0))

    def forward(self, observed):
        z_e, z_a = super().forward(observed)
        return Posterior(Gaussian(z_e, self.spread, self.parameters_of_system), Gaussian(z_a, self.spread), z_a)


class DropoutEncoder(LinearEncoder):
    def forward(self, observed):
        return super().forward(nn.functional.dropout(observed))


class DropoutGRU(GRUEncoder):
    def forward(self, observed):
        return super().forward(nn.functional.dropout(observed))


class FlatEncoder(LinearEncoder):
    def forward(self, observed):
        return super().forward(observed)[0][:, 0]


class LinearInteraction(nn.Module):
    """forward(y, z_a) is all there is; a scalar among its parameters."""

    def __init__(self, system, latent, width=6):
        super().__init__()
        size = len(system.state)
        self.layers = nn.Sequential(nn.Linear(size + latent, width), nn.LayerNorm(width), nn.Linear(width, size))
        self.gain = nn.Parameter(torch.tensor(0.3))

    def forward(self, y, z_a):
        return self.gain * self.layers(torch.cat((y, z_a), -1))


class SpectralInteraction(nn.Module):
    """spectral_norm of either kind, which keeps its power iteration in buffers; also told z_e."""

    def __init__(self, system, latent):
        super().__init__()
        size = len(system.state)
        self.first = nn.utils.parametrizations.spectral_norm(nn.Linear(size + latent + 1, 8))
        self.second = nn.utils.spectral_norm(nn.Linear(8, size))

    def context(self, z_a, z_e):
        return torch.cat((z_a, z_e[:, :1]), -1)

    def forward(self, y, context):
        return self.second(torch.tanh(self.first(torch.cat((y, context), -1))))


class OwnInteraction(Interaction):
    """A subclass of the package's own."""

    def __init__(self, **options):
        super().__init__(**options, expert_parameters=True)
        self.layer = nn.Linear(self.inputs, len(self.acts_on))

    def forward(self, y, context):
        return self.placed(self.layer(context), y)


class WrongShape(LinearInteraction):
    def forward(self, y, z_a):
        return super().forward(y, z_a)[:, :1]


class ScalarLoss(Aphynity):
    """A mistake: one loss for all seeds."""

    def loss(self, model, batch, task):
        loss, parts = super().loss(model, batch, task)
        return loss.mean(), parts
