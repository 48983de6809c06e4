"""The squared error that is to be expected of a forecast, against the one that it has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from fitted_pendulum import PRIOR, expert_alone, pendulum

import tiny
from cards import card
from expertaug.evaluation.score import score
from expertaug.evaluation.settings import Scoring
from expertaug.inference.expected_error import expected_errors, record_misfits
from expertaug.inference.least_squares import estimator_of
from expertaug.learning.settings import TrainSettings
from expertaug.learning.train import run_stage as train
from expertaug.models import store
from expertaug.models.decoder import Decoder
from expertaug.models.fit_settings import RefinementSettings
from expertaug.models.settings import PartsSettings
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.settings import SolverSettings
from expertaug.systems.simulate import trajectories
from expertaug.trajectories import Trajectories
from nightly import others_slow
from seen import seen
from tiny import but

T, NOISE, CPU = np.linspace(0.0, 6.0, 61), 0.01, torch.device("cpu")
SCORING = Scoring(draws=8, drawn_samples=1)


@pytest.mark.parametrize("observed", others_slow([21, 51]))
def test_a_fit_of_the_right_equation_expects_the_error_that_it_has(observed):
    system = DampedPendulum()
    data = trajectories(system, {"omega0": (1.5, 3.1)}, {"alpha": (0.0, 0.0)}, n=80, t=T, noise=NOISE, seed=3)
    described = {"kind": "least_squares", "system": {"name": "pendulum"}, "t": T.tolist(), "observed": observed}
    described |= {"bound": [30.0, 90.0], "training": {}, "seeds": [0]}
    stored = store.StoredModel(Decoder(system), card(described))
    stored = replace(stored, model=estimator_of(stored, None, NOISE, {"omega0": (0.5, 3.5)}))
    scored = score(stored, data, SCORING, "y0", CPU, noise=NOISE)
    own = scored.errors.mean() - 2 * NOISE**2  # of the data, which have noise in both components
    assert scored.moved is None and scored.expected.shape == (1, 80)
    assert 0.6 < scored.expected.mean() / own < 1.7
    assert score(stored, data, SCORING.without_draws, "y0", CPU, noise=NOISE).expected is None
    more = score(stored, data, Scoring(draws=19, drawn_samples=1), "y0", CPU, noise=NOISE)
    assert torch.equal(more.expected, scored.expected), "expected_draws are 8, however many are drawn"
    other, as_before = (
        score(stored, data, Scoring(draws=8, drawn_samples=4, **solver), "y0", CPU, noise=NOISE)
        for solver in ({"draws_solver": SolverSettings(method="rk4")}, {})
    )
    assert torch.equal(other.errors, scored.errors), "draws are solved otherwise, forecasts are not"
    assert not torch.equal(other.expected, scored.expected)
    for one in ("crps", "energy"):
        apart = getattr(other.drawn, one) - getattr(as_before.drawn, one)
        assert 0 < np.abs(apart).max() < 1e-3


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    sets = dict.fromkeys(("train", "validation"), tiny.swings(12))
    folder = tiny.simulated(tmp_path_factory.mktemp("expected"), tiny.DATA.model_copy(update={"sets": sets}))
    encoder, interaction = {"kind": "recurrent", "hidden": 4, "layers": [4]}, {"kind": "mlp", "layers": [4, 4]}
    model = PartsSettings(encoder=encoder, interaction=interaction)
    job = but(tiny.SETTINGS, seeds=[4, 7], model=model, training=TrainSettings(epochs=1, batch_size=6))
    train(folder, folder / "model.safetensors", folder / "work", job, None)
    return store.load(folder / "model.safetensors", CPU), Trajectories.load(folder / "validation.npz")


def test_refinement_expects_of_the_encoder_what_lies_between_their_forecasts(model):
    encoder, data = model
    refined = replace(encoder, model=estimator_of(encoder, RefinementSettings(steps=5), NOISE, {"omega0": (0.5, 3.5)}))
    before, after = (score(one, data, SCORING, "y0", CPU, keep=len(data), noise=NOISE) for one in (encoder, refined))
    assert before.moved is None and after.moved is not None and after.expected is not None
    observed = encoder.card.observed
    between = (after.prediction - before.prediction)[:, :, observed:].double().square().sum(-1).mean(-1)
    torch.testing.assert_close(after.moved[:, after.index], between, rtol=1e-5, atol=1e-8)


def test_a_record_keeps_what_is_expected_of_validation_windows_and_decoders_expect_nothing():
    data = pendulum((1.5, 3.1), n=3)
    stored = expert_alone("pendulum", data)
    stored = replace(stored, card=stored.card.but(t=T[:21].tolist(), observed=11))
    stored = replace(stored, model=estimator_of(stored, RefinementSettings(starts=4, tries=1), NOISE, PRIOR))
    windows = seen(torch.from_numpy(data.y[:, :11]).movedim(1, 0).unsqueeze(1))
    record = record_misfits(stored, windows)
    assert np.shape(record.validation) == np.shape(record.expected) == (2, 3)
    assert record.validation[0] == record.validation[1], "both seeds are the expert alone,"
    assert record.between == pytest.approx([0.0] * 3, abs=1e-12), "and forecast the same"
    both = windows.expand(2)
    within, between = expected_errors(stored, stored.model.estimate(both), both)
    np.testing.assert_allclose(record.expected, within, rtol=1e-5)
    assert between.shape == (3,) and (within > 0).all()
    alone = replace(stored, model=stored.model.decoder)
    assert expected_errors(alone, stored.model.estimate(both), both) is None
