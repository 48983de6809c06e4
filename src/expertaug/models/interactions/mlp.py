"""An interaction model that is a fully connected network of the state."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.models.interactions.base import Interaction
from expertaug.models.networks.layers import MLP, Linear, affine, feature_count
from expertaug.models.networks.linearised import linearised
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
        self.sees_inputs, self.sees_time, self.width = own.inputs, own.time, sum(own.layers)
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
        return self._function(context)(y, known)

    def along(self, context: Tensor) -> Callable[..., Tensor]:
        """As of :class:`Interaction`."""
        return self._function(context) if self._is_own else super().along(context)

    def linearised(self, context: Tensor) -> Callable[..., tuple[Tensor, Tensor]] | None:
        """As of :class:`Interaction`."""
        if self.grid or not self._is_own:
            return None
        layers, features = self._layers(context), self._features(context)

        def rates(y: Tensor, known: Tensor | None = None) -> tuple[Tensor, Tensor]:
            with torch.enable_grad():
                y = y.detach().requires_grad_()
                x = features(y, known)
            value, slopes = linearised(x, layers, self.rest.activation, self.acts_on)
            return value, torch.stack([torch.autograd.grad(x, y, row, retain_graph=True)[0] for row in slopes])

        return rates

    @property
    def _is_own(self) -> bool:
        """Whether no subclass computes something else."""
        return type(self).forward is MLPInteraction.forward

    def _function(self, context: Tensor) -> Callable[..., Tensor]:
        """F_a of y and known for one context, without modules: looking up what they hold takes longer than a small
        network's products."""
        (*layers, last), features, activation = self._layers(context), self._features(context), self.rest.activation

        def rates(y: Tensor, known: Tensor | None = None) -> Tensor:
            x = features(y, known)
            for weight, bias in layers:
                x = activation(affine(x, weight, bias))
            x = affine(x, *last)
            return self.placed(x.unflatten(-1, (-1, *self.grid)), y) if self.grid else x

        return rates

    def _layers(self, context: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Weights and biases; of states without a grid the last layer gives the rates of all components."""
        layers = [(self.state_layer.weight, context), *((layer.weight, layer.bias) for layer in self.rest.layers)]
        if self.grid or len(self.acts_on) == len(self.mask):
            return layers
        places = constant_like(context, self.acts_on, torch.long)
        weight, bias = (x.new_zeros(*x.shape[:-1], len(self.mask)).index_copy(-1, places, x) for x in layers[-1])
        return [*layers[:-1], (weight, bias)]

    def _features(self, context: Tensor) -> Callable[..., Tensor]:
        """What the first layer sees, of y and known."""
        features = self.system.features
        mask = None if all(self.mask) else constant_like(context, self.mask, context.dtype)
        mask = None if mask is None else mask.view(-1, *[1] * len(self.grid))

        def seen(y: Tensor, known: Tensor | None = None) -> Tensor:
            x = features(y if mask is None else y * mask)
            return x if known is None else torch.cat((x, self._known_features(known)), dim=-1)

        return seen

    def _known_features(self, known: Tensor) -> Tensor:
        """Known inputs and time in their units (…, B, U), and sines and cosines of the time."""
        extra = known / constant_like(known, self.units, known.dtype)
        if self.orders:
            phases = 2 * math.pi * extra[..., -1:] * constant_like(extra, self.orders, extra.dtype)
            extra = torch.cat((extra[..., :-1], torch.sin(phases), torch.cos(phases)), dim=-1)
        return extra
