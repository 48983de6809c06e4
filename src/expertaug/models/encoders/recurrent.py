"""Encoder of whole windows by a recurrent network."""

from __future__ import annotations

from typing import Any

from torch import Tensor, nn

from expertaug.models.networks.layers import GRU, MLP, feature_count
from expertaug.models.posterior import Delta, Posterior, constrain
from expertaug.models.settings import RecurrentSettings, configure_by
from expertaug.systems import System


@configure_by(RecurrentSettings)
class RecurrentEncoder(nn.Module):
    """GRU over the observed states; z_a is its last hidden state, an MLP maps it to z_e (paper, appendix, pendulum).

    Arguments:
        times: of the observed window, unused: the GRU sees every point.
    """

    stackable = True
    head_prefix = "head."

    def __init__(self, system: System, times: Tensor, **options: Any) -> None:
        super().__init__()
        own = RecurrentSettings.of(**options)
        self.system = system
        self.latent = own.hidden
        inputs = feature_count(system, "model.encoder.kind")
        self.recurrent = GRU(inputs, own.hidden)
        self.head = MLP(own.hidden, own.layers, len(system.expert_parameters))

    def fit(self, observed: Tensor) -> None:
        """Nothing to learn from the data before training."""

    def forward(self, observed: Tensor) -> Posterior:
        """(T1, …, B, *state) → z_e (…, B, P), z_a (…, B, hidden)."""
        hidden = self.recurrent(self.system.features(observed))
        return Posterior(Delta(constrain(self.head(hidden), self.system.expert_parameters)), Delta(hidden))
