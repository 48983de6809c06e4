"""The p⁺ of a user who gives none."""

from __future__ import annotations

import numpy as np
import pytest
from small_pendulum import OPTIONS, SEEN, T

import expertaug as ea


@pytest.fixture(scope="module")
def undamped():
    return ea.simulate(ea.DampedPendulum(), SEEN, {"alpha": (0.0, 0.0)}, n=40, t=T, noise=0.01, name="train")


def test_least_squares_finds_where_its_fits_start(undamped):
    fitted = ea.least_squares(ea.DampedPendulum(), undamped, observed_s=1.0, noise=0.01)
    low, high = fitted.refinement.prior["omega0"]
    assert 0.5 < low < 1.0 and 5.0 < high < 7.5  # twice the training's
    found = fitted.forecast(undamped.y[:, :11], T)
    assert np.median(np.abs(found.z_e["omega0"] - undamped.z_e[:, 0])) < 0.05


@pytest.mark.slow
def test_augmentation_and_flows_find_their_own(sets, fit, caplog):
    with caplog.at_level("INFO"):
        drawn = ea.augment(fit, sets["train"], sets["validation"], noise=0.01)
    assert "p⁺: no windows were given: the ranges were widened to omega0 in [" in caplog.text
    prior = drawn.drawn.drawing.prior["omega0"]
    z_e = drawn.train[0].z_e
    assert prior[0] <= z_e.min() and z_e.max() <= prior[1]
    tuned = ea.finetune(fit, sets["train"], sets["validation"], noise=0.01, **OPTIONS)
    assert tuned.stored.card.augmented_prior == drawn.drawn.drawing.prior
    tiny = {"steps": 2, "batch_size": 8, "pool": 16, "held_out": 8, "samples": 3, "solver": {"method": "rk4"}}
    flow = ea.fit_posterior(fit, sets["train"], noise=0.01, **tiny)
    assert flow.stored.card.prior == drawn.drawn.drawing.prior


def test_the_budget_can_be_asked_for(sets, undamped):
    fitted = ea.least_squares(ea.DampedPendulum(), undamped, observed_s=1.0, noise=0.01, prior={"omega0": (1.0, 4.0)})
    found = ea.own_prior(fitted, undamped, noise=0.01, prior={"omega0": (1.0, 4.0)}, budget=1.4)
    assert found.ranges["omega0"][1] == pytest.approx(1.4 * found.training["omega0"][1])
    with pytest.raises(ea.InputError, match="budget: found"):
        ea.own_prior(fitted, undamped, noise=0.01, prior={"omega0": (1.0, 4.0)}, budget=0.5)
