"""An interaction model that is a fully connected network of the state."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.models.interactions.base import Interaction
from expertaug.models.networks.layers import MLP, Linear, affine, feature_count
from expertaug.systems import System
from expertaug.systems.base import constant_like


class MLPInteraction(Interaction):
    """MLP on the state's features and z_a (paper, appendix).

    The part of the first layer that reads z_a is constant along a trajectory: :meth:`context` computes it once.

    Arguments:
        latent: size of z_a.
        layers, activation: hidden layers.
        expert_parameters, components, reads: as :class:`Interaction`; a component that it does not see is zero.
        inputs: whether it sees the system's known inputs, each divided by its scale.
        time: whether it sees the time, divided by the end of the observed window.
        times: of the observed window in s, (T1,).
        start: of the last layer's usual first size; near zero the expert is alone at first.
    """

    stackable = True

    def __init__(
        self,
        system: System,
        latent: int,
        layers: Sequence[int] = (50, 50, 50),
        activation: str = "relu",
        expert_parameters: bool = False,
        components: Sequence[str] | None = None,
        reads: Sequence[str] | None = None,
        inputs: bool = False,
        time: bool = False,
        times: Tensor | None = None,
        start: float = 1.0,
    ) -> None:
        super().__init__(system, latent, expert_parameters, components, reads)
        if inputs and not system.known:
            found = f"{type(system).__name__} has no known inputs"
            raise InputError("model.interaction.inputs", found, "leave it out")
        self.sees_inputs, self.sees_time = inputs, time
        self.units = [p.scale for p in system.known] if inputs else []
        if time:
            self.units.append(1.0 if times is None else max(float(times[-1]), 1e-12))
        self.system = system
        self.mask = [float(k in self.sees) for k in range(len(system.state))]
        features = feature_count(system, "model.interaction.kind") + len(self.units)
        self.state_layer = Linear(features, layers[0], bias=False)
        self.latent_layer = Linear(self.inputs, layers[0])
        self.rest = MLP(layers[0], layers[1:], len(self.acts_on), activation)
        for parameter in self.rest.layers[-1].parameters():
            parameter.data *= start

    def context(self, z_a: Tensor, z_e: Tensor) -> Tensor:
        """z_a (…, B, latent) and z_e (…, B, P) → (…, B, width), for :meth:`forward`."""
        return self.latent_layer(self.latents(z_a, z_e))

    def forward(self, y: Tensor, context: Tensor, known: Tensor | None = None) -> Tensor:
        """F_a at states y (…, B, *state), the shape of y; ``known`` as of :class:`Interaction`."""
        seen = y if all(self.mask) else y * constant_like(y, self.mask, y.dtype)
        features = self.system.features(seen)
        if known is not None:
            features = torch.cat((features, known / constant_like(known, self.units, known.dtype)), dim=-1)
        hidden = affine(features, self.state_layer.weight, context)
        return self.placed(self.rest(self.rest.activation(hidden)), y)
