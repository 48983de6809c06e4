"""Encoders: from the observed window to a posterior over (z_e, z_a).

An encoder is a module with ``latent`` (size of z_a), ``head_prefix`` (parameters of the z_e head alone) and
``forward(observed) → Posterior``, observed being (T1, …, B, *state).  ``fit`` sees the training set's observed window
once, before training.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.models.layers import GRU, MLP, Linear
from expertaug.models.posterior import Delta, Posterior
from expertaug.systems import Parameter, System


def constrain(raw: Tensor, parameters: Sequence[Parameter]) -> Tensor:
    """Unbounded network outputs (…, P) → parameters in their units: softplus where positive, scaled to their size."""
    scale = raw.new_tensor([p.scale for p in parameters])
    positive = torch.tensor([p.positive for p in parameters], device=raw.device)
    return scale * torch.where(positive, nn.functional.softplus(raw), raw)


class RecurrentEncoder(nn.Module):
    """GRU over the observed states; z_a is its last hidden state, an MLP maps it to z_e (paper, appendix, pendulum).

    Arguments:
        hidden: units of the GRU and size of z_a.
        layers: hidden layers of the z_e head.
        times: of the observed window, unused: the GRU sees every point.
    """

    head_prefix = "head."

    def __init__(
        self, system: System, times: Tensor, hidden: int = 128, layers: Sequence[int] = (150, 150, 150)
    ) -> None:
        super().__init__()
        self.system = system
        self.latent = hidden
        inputs = system.features(torch.zeros(1, *system.state_shape)).shape[-1]
        self.recurrent = GRU(inputs, hidden)
        self.head = MLP(hidden, layers, len(system.expert_parameters))

    def fit(self, observed: Tensor) -> None:
        """Nothing to learn from the data before training."""

    def forward(self, observed: Tensor) -> Posterior:
        """(T1, …, B, *state) → z_e (…, B, P), z_a (…, B, hidden)."""
        hidden = self.recurrent(self.system.features(observed))
        return Posterior(Delta(constrain(self.head(hidden), self.system.expert_parameters)), Delta(hidden))


class WindowEncoder(nn.Module):
    """MLP over windows of chosen components (paper, appendix, double pendulum).

    An angle enters as the sine and cosine of every point and, since the network must tell speeds far beyond its
    training range from differences of nearly equal angles, as the sines of the increments from point to point.  Inputs
    are standardised by the training set, each on its own: a full whitening blows up what the training set hardly
    varies, and an augmented sample then lies thousands of units away.

    Arguments:
        windows: component name → [first, last] time in s, both included; the first point of every component named
            belongs to x and is seen as well.
        angles: components that enter as angles.
        layers, activation: of the MLP.
        latent: size of z_a.
        skip: whether a linear map of the inputs is added to the z_e head's output.
    """

    head_prefix = "head."

    def __init__(
        self,
        system: System,
        times: Tensor,
        windows: Mapping[str, Sequence[float]],
        angles: Sequence[str] = (),
        layers: Sequence[int] = (300, 300, 300),
        latent: int = 10,
        activation: str = "relu",
        skip: bool = False,
    ) -> None:
        super().__init__()
        self.system = system
        self.latent = latent
        self.points = [(*self._select(name, window, times), name in angles) for name, window in windows.items()]
        inputs = sum(3 * len(points) - 1 if angle else len(points) for _, points, angle in self.points)
        self.register_buffer("mean", torch.zeros(1, inputs))
        self.register_buffer("std", torch.ones(1, inputs))
        self.trunk = MLP(inputs, layers[:-1], layers[-1], activation)
        self.head = MLP(layers[-1], (), len(system.expert_parameters))
        self.latent_head = MLP(layers[-1], (), latent)
        self.skip = Linear(inputs, len(system.expert_parameters), bias=False) if skip else None

    def _select(self, name: str, window: Sequence[float], times: Tensor) -> tuple[int, list[int]]:
        """Index of a component and of its points."""
        names = [p.name for p in self.system.state]
        if name not in names:
            raise InputError(f"model.encoder.windows.{name}", "unknown", f"components: {', '.join(names)}")
        first, last = window
        inside = [k for k, t in enumerate(times.tolist()) if first - 1e-9 <= t <= last + 1e-9]
        if not inside:
            where = f"model.encoder.windows.{name}"
            raise InputError(where, f"[{first}, {last}] s", f"choose within 0 to {float(times[-1]):g} s")
        return names.index(name), sorted({0, *inside})

    def inputs(self, observed: Tensor) -> Tensor:
        """(T1, …, B, *state) → (…, B, inputs)."""
        columns = []
        for component, points, angle in self.points:
            value = observed[points][..., component]
            columns += [torch.sin(value), torch.cos(value), torch.sin(value.diff(dim=0))] if angle else [value]
        return torch.cat(columns).movedim(0, -1)

    def fit(self, observed: Tensor) -> None:
        """Standardise by the training set's observed window (T1, N, *state)."""
        x = self.inputs(observed)
        self.mean.copy_(x.mean(0, keepdim=True).expand_as(self.mean))
        self.std.copy_(x.std(0, keepdim=True).clamp_min(1e-6).expand_as(self.std))

    def forward(self, observed: Tensor) -> Posterior:
        """(T1, …, B, *state) → z_e (…, B, P), z_a (…, B, latent)."""
        x = (self.inputs(observed) - self.mean) / self.std
        hidden = self.trunk.activation(self.trunk(x))
        raw = self.head(hidden) if self.skip is None else self.head(hidden) + self.skip(x)
        return Posterior(Delta(constrain(raw, self.system.expert_parameters)), Delta(self.latent_head(hidden)))
