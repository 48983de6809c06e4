"""The recurrent encoder: what it sees, and what it says of it."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from expertaug.errors import InputError
from expertaug.models.encoders.recurrent import RecurrentEncoder
from expertaug.systems.reaction_diffusion import ReactionDiffusion
from expertaug.systems.rlc import RLC

TIMES = torch.arange(6) * 0.1


def test_it_sees_every_point_and_its_head_makes_positive_parameters_of_z_a():
    torch.manual_seed(0)
    encoder = RecurrentEncoder(RLC(), TIMES, hidden=4, layers=(5,))
    observed = torch.randn(6, 3, 2, requires_grad=True)
    found = encoder(observed)
    scale = torch.tensor([p.scale for p in RLC().expert_parameters])
    torch.testing.assert_close(found.z_e.mean, scale * nn.functional.softplus(encoder.head(found.z_a.mean)))
    assert found.z_a.mean.shape == (3, encoder.latent) == (3, 4)
    found.z_a.mean[1].sum().backward()
    assert (observed.grad[:, 1].abs().sum(-1) > 0).all() and (observed.grad[:, [0, 2]] == 0).all()


def test_fields_are_refused_in_a_line():
    with pytest.raises(InputError, match="choose one for fields"):
        RecurrentEncoder(ReactionDiffusion(), TIMES)
