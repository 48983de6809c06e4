"""Assumption A1: where F_a holds along z_e, and how far it is from the truth."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import nn

from expertaug.errors import InputError
from expertaug.inference.diagnostics.validity import along, error_of_interaction
from expertaug.models.decoder import Decoder
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.simulate import trajectories


def test_it_holds_as_far_as_windows_are_explained():
    random = np.random.default_rng(0)
    train, known = random.uniform(1.5, 3.1, 200), 1 + 0.1 * random.random(200)
    z_e = random.uniform(0.5, 3.1, 400)
    chi2 = np.where(z_e > 0.9, 1.0, 40.0)
    found = along("omega0", z_e, chi2, train, known)
    low, high = found.holds
    assert 0.8 <= low <= 1.2 and high == pytest.approx(3.1, abs=0.02)
    assert "F_a learned on omega0 in [1.5, 3.1] holds in" in found.says
    assert found.explained[0] < 0.5 and found.chi2[0] > 10


def test_an_f_a_that_does_not_explain_its_own_range_says_so():
    z = np.linspace(1, 2, 50)
    found = along("a", z, np.full(50, 30.0), z, np.ones(50))
    assert found.holds is None and "does not explain its own range" in found.says


def test_mistakes_are_one_line():
    z = np.linspace(1, 2, 5)
    with pytest.raises(InputError, match="chi2: has shape"):
        along("a", z, np.ones(4), z, np.ones(5))
    with pytest.raises(InputError, match="leave these windows out"):
        along("a", z, np.full(5, np.nan), z, np.ones(5))
    with pytest.raises(InputError, match="has no interaction model"):
        decoder = Decoder(DampedPendulum())
        error_of_interaction(decoder, [0.0], *[torch.zeros(1, 1, 2)] * 3, *[torch.zeros(1, 1, 1)] * 2)


class Friction(nn.Module):
    """−share · z_a θ', as the package calls an interaction model."""

    def __init__(self, share: float) -> None:
        super().__init__()
        self.share = share

    def context(self, z_a, z_e):
        return z_a

    def forward(self, y, context):
        return torch.cat((torch.zeros_like(context), -self.share * context * y[..., 1:]), -1)


@pytest.mark.parametrize("share", [1.0, 0.8, 0.0])
def test_the_error_is_a_share_of_the_true_interaction(share):
    system = DampedPendulum()
    data = trajectories(system, {"omega0": (1.5, 3.1)}, {"alpha": (0.2, 0.6)}, n=6, t=np.arange(21) * 0.1)
    y, z_e, z_a = (torch.from_numpy(v) for v in (data.y, data.z_e, data.z_a))
    decoder = Decoder(system, Friction(share))
    seeds = [v.expand(2, *v.shape) for v in (z_e, z_a)]
    found = error_of_interaction(decoder, data.t, y.movedim(1, 0), z_e, z_a, *seeds)
    torch.testing.assert_close(found, torch.full((2, 6), 1 - share, dtype=torch.float64), atol=1e-5, rtol=1e-4)
