"""Layers of one seed compute what those of torch do."""

from __future__ import annotations

import pytest
import torch

from expertaug.models.networks.layers import GRU, Standardise


def test_gru_is_torchs():
    ours, theirs = GRU(3, 4), torch.nn.GRU(3, 4)
    with torch.no_grad():
        theirs.weight_ih_l0.copy_(torch.cat([layer.weight.T for layer in ours.inputs]))
        theirs.weight_hh_l0.copy_(torch.cat([layer.weight.T for layer in ours.recurrent]))
        theirs.bias_ih_l0.copy_(torch.cat([layer.bias[0] for layer in ours.inputs]))
        theirs.bias_hh_l0.zero_()
        theirs.bias_hh_l0[8:] = ours.recurrent[2].bias[0]
        x = torch.randn(7, 5, 3)
        torch.testing.assert_close(ours(x), theirs(x)[1][0])


def test_an_input_that_training_holds_constant_is_not_blown_up():
    scale = Standardise(2)
    scale.fit(torch.stack((torch.zeros(9), torch.arange(9.0)), dim=1))
    assert scale(torch.tensor([[0.3, 4.0]])).tolist() == [[pytest.approx(0.3), 0.0]]
