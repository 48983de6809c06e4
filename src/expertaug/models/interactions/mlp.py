"""An interaction model that is a fully connected network of the state."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from expertaug.models.interactions.base import Interaction
from expertaug.models.networks.layers import MLP, Linear, affine, feature_count
from expertaug.systems import System


class MLPInteraction(Interaction):
    """MLP on the state's features and z_a (paper, appendix).

    The part of the first layer that reads z_a is constant along a trajectory: :meth:`context` computes it once.

    Arguments:
        latent: size of z_a.
        layers, activation: hidden layers.
        expert_parameters, components, reads: as :class:`Interaction`; a component that it does not see is zero.
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
        start: float = 1.0,
    ) -> None:
        super().__init__(system, latent, expert_parameters, components, reads)
        self.system = system
        self.mask = [float(k in self.sees) for k in range(len(system.state))]
        features = feature_count(system, "model.interaction.kind")
        self.state_layer = Linear(features, layers[0], bias=False)
        self.latent_layer = Linear(self.inputs, layers[0])
        self.rest = MLP(layers[0], layers[1:], len(self.acts_on), activation)
        for parameter in self.rest.layers[-1].parameters():
            parameter.data *= start

    def context(self, z_a: Tensor, z_e: Tensor) -> Tensor:
        """z_a (…, B, latent) and z_e (…, B, P) → (…, B, width), for :meth:`forward`."""
        return self.latent_layer(self.latents(z_a, z_e))

    def forward(self, y: Tensor, context: Tensor) -> Tensor:
        """F_a at states y (…, B, *state), the shape of y."""
        seen = y if all(self.mask) else y * y.new_tensor(self.mask)
        hidden = affine(self.system.features(seen), self.state_layer.weight, context)
        return self.placed(self.rest(self.rest.activation(hidden)), y)
