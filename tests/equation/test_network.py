"""What a network F_a does at the states that windows visit is read as terms."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import expertaug as ea
from expertaug.equation import network
from expertaug.equation.shooting import Formula
from expertaug.models.card import LatentRecord
from expertaug.models.hybrid import build_decoder
from expertaug.models.posterior import Estimates
from expertaug.models.store import StoredModel
from rubbed_swings import T, fitted, swings


class Learned(torch.nn.Module):
    """F_a that is a friction and hardly anything else."""

    def __init__(self, rate=0.3):
        super().__init__()
        self.rate = torch.nn.Parameter(torch.tensor(rate))

    def forward(self, y, z_a):
        drag = self.rate * y[..., 1] + 0.003 * torch.cos(3 * y[..., 0])
        return torch.stack((torch.zeros_like(drag), -drag), dim=-1)


def with_network(model, seeds=(0, 1)):
    """The same expert with a known F_a, as training would have left it."""
    decoder = build_decoder(model.system, Learned, 0, seeds, T[: model.observed])
    card = model.stored.card.but(kind="alternating", seeds=list(seeds), interaction=True, latent_size=0)
    card = card.but(latent=LatentRecord(mean=[[]] * len(seeds), std=[[]] * len(seeds)))
    return ea.TrainedModel(StoredModel(decoder, card), refinement=model.refinement)


@pytest.mark.slow
def test_a_networks_term_is_read_and_told_how_far():
    train, validation = (swings(name, n=8, alpha=(0.3, 0.3)) for name in ("train", "validation"))
    model = with_network(fitted(train, units={"omega0": "window"}, starts=4, tries=1))
    found = ea.explain(model, train, validation, components=["omega"], most_terms=2)
    (one,) = found.coefficients
    assert str(one.term) == "omega: omega" and one.survival == 1
    assert one.value == pytest.approx(-0.3, abs=0.02)
    assert 0.99 < found.explained < 1
    assert list(found.table.index) == ["expert alone", "network", "equation"]
    assert found.table.loc["network", "log-MSE"] < found.table.loc["expert alone", "log-MSE"] - 1


def test_a_friction_is_read_from_the_states_that_it_was_asked_at():
    """Beside the term the expert's own parameter is free: what is left of F_a is that of a linear fit of both."""
    system, y = ea.DampedPendulum(), np.random.default_rng(0).standard_normal((9, 4, 2))
    decoder, states = build_decoder(system, Learned, 0, [0], T), torch.from_numpy(y).unsqueeze(1)
    estimates = Estimates(states[0], torch.full((1, 4, 1), 2.0), torch.zeros(1, 4, 0))
    terms, sizes = [ea.Term("omega", text) for text in ("1", "omega")], torch.ones(2, dtype=torch.float64)
    (found,) = network.describe_learned(
        decoder, estimates, states, torch.arange(9) * 0.1, None, terms, sizes, [0], False
    )
    one = Formula((terms[1],), (True,))
    assert found.formulas(3)[0] == one and found.numbers == 4 * 9
    theta, omega = y[..., 0].ravel(), y[..., 1].ravel()
    pushed = -0.3 * omega - 0.003 * np.cos(3 * theta)
    columns = np.stack((-4 * np.sin(theta), omega), axis=1)
    left = pushed - columns @ np.linalg.lstsq(columns, pushed, rcond=None)[0]
    assert found.explained(one) == pytest.approx(1 - (left**2).sum() / (pushed**2).sum(), abs=1e-6)
    assert found.explained(one) > 0.99 > found.explained(Formula())
