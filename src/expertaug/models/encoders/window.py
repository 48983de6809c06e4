"""Encoder of windows of chosen components by a fully connected network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from torch import Tensor, nn

from expertaug.models.encoders.views import Windows
from expertaug.models.networks.layers import MLP, Linear, Standardise
from expertaug.models.posterior import Delta, Posterior, constrain
from expertaug.systems import System


class WindowEncoder(nn.Module):
    """MLP over windows of chosen components (paper, appendix, double pendulum).

    Inputs (:class:`Windows`) are standardised by the training set, each on its own: a full whitening blows up what the
    training set hardly varies, and an augmented sample then lies thousands of units away.

    Arguments:
        windows: component name → [first, last] time in s, both included; the first point of every component named
            belongs to x and is seen as well.
        angles: components that enter as angles.
        layers, activation: of the MLP.
        latent: size of z_a.
        skip: whether a linear map of the inputs is added to the z_e head's output.
    """

    stackable = True
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
        self.window = Windows(system, times, windows, angles)
        inputs = self.window.inputs
        self.scale = Standardise(inputs)
        self.trunk = MLP(inputs, layers[:-1], layers[-1], activation)
        self.head = MLP(layers[-1], (), len(system.expert_parameters))
        self.latent_head = MLP(layers[-1], (), latent)
        self.skip = Linear(inputs, len(system.expert_parameters), bias=False) if skip else None

    def inputs(self, observed: Tensor) -> Tensor:
        """(T1, …, B, *state) → (…, B, inputs)."""
        return self.window.features(self.window(observed))

    def fit(self, observed: Tensor) -> None:
        """Standardise by the training set's observed window (T1, N, *state)."""
        self.scale.fit(self.inputs(observed))

    def forward(self, observed: Tensor) -> Posterior:
        """(T1, …, B, *state) → z_e (…, B, P), z_a (…, B, latent)."""
        x = self.scale(self.inputs(observed))
        hidden = self.trunk.activation(self.trunk(x))
        raw = self.head(hidden) if self.skip is None else self.head(hidden) + self.skip(x)
        return Posterior(Delta(constrain(raw, self.system.expert_parameters)), Delta(self.latent_head(hidden)))
