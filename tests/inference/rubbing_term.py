"""A friction as F_a, of two seeds, in a model of the pendulum that windows are fitted with."""

from __future__ import annotations

import torch
from fitted_pendulum import expert_alone
from torch import nn

from expertaug.models.store import StoredModel


class Friction(nn.Module):
    """−z_a θ' − drag θ' |θ'| of two seeds, of which the training found the first part alone."""

    def __init__(self, drag: float = 0.0) -> None:
        super().__init__()
        self.drag = nn.Parameter(torch.full((2, 1, 1), drag))

    def context(self, z_a, z_e):
        return z_a

    def forward(self, y, context):
        speed = y[..., 1:]
        return torch.cat((torch.zeros_like(speed), -context * speed - self.drag * speed * speed.abs()), -1)


def stored(decoder, data):
    alone = expert_alone("pendulum", data).card
    latent = {"mean": [[0.3]] * 2, "std": [[0.17]] * 2}
    return StoredModel(decoder, alone.but(kind="alternating", latent=latent))
