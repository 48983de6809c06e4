"""The squared error that is to be expected of a forecast, against the one that it has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

import tiny
from cards import card
from expertaug import systems
from expertaug.evaluation.score import score
from expertaug.inference.least_squares import estimator_of
from expertaug.models import store
from expertaug.models.decoder import Decoder
from expertaug.systems.simulate import trajectories
from expertaug.trajectories import Trajectories
from typed_jobs import train

T, NOISE, CPU = np.linspace(0.0, 10.0, 101), 0.01, torch.device("cpu")
OPTIONS = {"draws": 8, "drawn_samples": 0, "noise": NOISE}
SET = {"size": 12, "z_e": {"omega0": [1.5, 3.1]}, "z_a": {"alpha": [0.0, 0.6]}}


@pytest.mark.parametrize("observed", [21, 51])
def test_a_fit_of_the_right_equation_expects_the_error_that_it_has(observed):
    system = systems.load({"name": "pendulum"})
    data = trajectories(system, {"omega0": (1.5, 3.1)}, {"alpha": (0.0, 0.0)}, n=80, t=T, noise=NOISE, seed=3)
    described = {"kind": "least_squares", "system": {"name": "pendulum"}, "t": T.tolist(), "observed": observed}
    described |= {"bound": [30.0, 90.0], "training": {}, "seeds": [0]}
    stored = store.StoredModel(Decoder(system), card(described))
    stored = replace(stored, model=estimator_of(stored, None, NOISE, {"omega0": (0.5, 3.5)}))
    scored = score(stored, data, OPTIONS, "y0", CPU)
    own = scored.errors.mean() - 2 * NOISE**2  # of the data, which have noise in both components
    assert scored.expected.keys() == {"expected"} and scored.expected["expected"].shape == (1, 80)
    assert 0.6 < scored.expected["expected"].mean() / own < 1.7
    assert not score(stored, data, OPTIONS | {"draws": 0}, "y0", CPU).expected
    fewer, more = (OPTIONS | {"draws": count, "expected_draws": 8} for count in (8, 19))
    same = [score(stored, data, options, "y0", CPU).expected["expected"] for options in (fewer, more)]
    assert torch.equal(*same) and torch.equal(same[0], scored.expected["expected"])
    coarse = OPTIONS | {"drawn_samples": 4, "draws_solver": {"method": "rk4"}}
    other, as_before = (
        score(stored, data, coarse, "y0", CPU),
        score(stored, data, OPTIONS | {"drawn_samples": 4}, "y0", CPU),
    )
    assert torch.equal(other.errors, scored.errors), "draws are solved otherwise, forecasts are not"
    assert not torch.equal(other.expected["expected"], scored.expected["expected"])
    for one in ("crps", "energy"):
        apart = getattr(other.drawn, one) - getattr(as_before.drawn, one)
        assert 0 < np.abs(apart).max() < 1e-3


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    data = {"seed": 0, "step_s": 0.1, "t2_s": 2.0, "noise": NOISE, "sets": dict.fromkeys(("train", "validation"), SET)}
    folder = tiny.simulated(tmp_path_factory.mktemp("expected"), data)
    settings = tiny.SETTINGS | {
        "seeds": [4, 7],
        "model": {
            "encoder": {"kind": "recurrent", "hidden": 4, "layers": [4]},
            "interaction": {"kind": "mlp", "layers": [4, 4]},
        },
        "training": {"epochs": 1, "batch_size": 6},
    }
    train(folder, folder / "model.safetensors", folder / "work", settings, None)
    return store.load(folder / "model.safetensors", CPU), Trajectories.load(folder / "validation.npz")


def test_refinement_expects_of_the_encoder_what_lies_between_their_forecasts(model):
    encoder, data = model
    refined = replace(encoder, model=estimator_of(encoder, {"steps": 5}, NOISE, {"omega0": (0.5, 3.5)}))
    before, after = (score(one, data, OPTIONS, "y0", CPU, keep=len(data)) for one in (encoder, refined))
    assert "moved" not in before.expected and after.expected.keys() == {"moved", "expected"}
    observed = encoder.card.observed
    between = (after.prediction - before.prediction)[:, :, observed:].double().square().sum(-1).mean(-1)
    torch.testing.assert_close(after.expected["moved"][:, after.index], between, rtol=1e-5, atol=1e-8)
