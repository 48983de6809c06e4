"""An interaction model that is a fully connected network of the state."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.models.interactions.base import Interaction
from expertaug.models.networks.layers import MLP, Linear, affine, feature_count
from expertaug.models.settings import MLPSettings, configure_by
from expertaug.systems import System
from expertaug.systems.base import constant_like


@configure_by(MLPSettings)
class MLPInteraction(Interaction):
    """MLP on the state's features and z_a (paper, appendix).

    The part of the first layer that reads z_a is constant along a trajectory: :meth:`context` computes it once.  A
    component that it does not see is zero; known inputs are divided by their scales, the time by the end of the
    observed window, of which sines and cosines have a whole number of periods.

    Arguments:
        latent: size of z_a.
        times: of the observed window in s, (T1,).
    """

    stackable = True

    def __init__(self, system: System, latent: int, times: Tensor | None = None, **options: Any) -> None:
        own = MLPSettings.of(**options)
        super().__init__(system, latent, own.expert_parameters, own.components, own.reads)
        if own.inputs and not system.known:
            problem = f"{type(system).__name__} has no known inputs"
            raise InputError("model.interaction.inputs", problem, "leave it out")
        self.sees_inputs, self.sees_time = own.inputs, own.time
        self.units = [p.scale for p in system.known] if own.inputs else []
        if own.time:
            self.units.append(1.0 if times is None else max(float(times[-1]), 1e-12))
        self.system = system
        self.mask = [float(k in self.sees) for k in range(len(system.state))]
        self.grid = system.state_shape[1:]
        self.orders = [float(order) for order in range(1, own.harmonics + 1)]
        extra = len(self.units) + (2 * len(self.orders) - 1 if self.orders else 0)
        features = feature_count(system, "model.interaction.kind") + extra
        self.state_layer = Linear(features, own.layers[0], bias=False)
        self.latent_layer = Linear(self.inputs, own.layers[0])
        self.rest = MLP(own.layers[0], own.layers[1:], len(self.acts_on) * math.prod(self.grid), own.activation)
        for parameter in self.rest.layers[-1].parameters():
            parameter.data *= own.start

    def context(self, z_a: Tensor, z_e: Tensor) -> Tensor:
        """z_a (…, B, latent) and z_e (…, B, P) → (…, B, width), for :meth:`forward`."""
        return self.latent_layer(self.latents(z_a, z_e))

    def forward(self, y: Tensor, context: Tensor, known: Tensor | None = None) -> Tensor:
        """F_a at states y (…, B, *state), the shape of y; ``known`` as of :class:`Interaction`."""
        seen = y if all(self.mask) else y * constant_like(y, self.mask, y.dtype).view(-1, *[1] * len(self.grid))
        features = self.system.features(seen)
        if known is not None:
            extra = known / constant_like(known, self.units, known.dtype)
            if self.orders:
                phases = 2 * math.pi * extra[..., -1:] * constant_like(extra, self.orders, extra.dtype)
                extra = torch.cat((extra[..., :-1], torch.sin(phases), torch.cos(phases)), dim=-1)
            features = torch.cat((features, extra), dim=-1)
        hidden = affine(features, self.state_layer.weight, context)
        rates = self.rest(self.rest.activation(hidden))
        return self.placed(rates.unflatten(-1, (-1, *self.grid)) if self.grid else rates, y)
