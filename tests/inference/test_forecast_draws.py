"""Draws of forecasts: bands of a right posterior hold, too sure ones do not, on a set and on a model's own windows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from known_posterior import NOISE as LINE_NOISE
from known_posterior import lines
from test_flow import asked as asked_of_flow
from test_least_squares import NOISE, OBSERVED, PRIOR, T, expert_alone, pendulum

from expertaug.evaluation.forecasting import Drawing, DrawnScores, of_own_windows
from expertaug.evaluation.score import score
from expertaug.evaluation.settings import Scoring
from expertaug.inference import simulations as own_windows_of
from expertaug.inference.flow_training import prepare
from expertaug.inference.least_squares import estimator_of
from expertaug.inference.posterior_predictive import joint_draws
from expertaug.inference.settings import OwnWindows
from expertaug.inference.simulations import own_draws
from expertaug.learning.random_streams import RandomStreams
from expertaug.models.decoder import Decoder
from expertaug.models.posterior import Delta, Estimates, Gaussian, Posterior
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.settings import SolverSettings
from expertaug.systems.solvers.solver import Solver
from expertaug.windows import Windows
from seen import seen

SCORING = Scoring(draws=39, drawn_samples=60, solver=SolverSettings(method="rk4"))
OWN = OwnWindows(prior={"omega0": (0.5, 3.5)})
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def fitted():
    """The expert alone, which is the truth of undamped windows, fitted to each of them."""
    data = pendulum((0.8, 3.1), n=80)
    stored = expert_alone("pendulum", data)
    return replace(stored, model=estimator_of(stored, None, NOISE, PRIOR)), data


def test_bands_of_laplaces_approximation_hold(fitted):
    stored, data = fitted
    found = score(stored, data, SCORING, "y0", CPU, keep=3, noise=NOISE)
    assert found.drawn.crps.shape == (2, 60) and found.band.shape == (2, 2, 3, len(T) - OBSERVED, 2)
    assert 84 < float(found.values["forecast_coverage_90"][0]) < 95
    assert 42 < float(found.values["forecast_coverage_50"][0]) < 58
    assert (found.band[0] < found.band[1]).all()
    # Noise alone has a CRPS of .23 standard deviations and half of √π for the vectors of two.
    assert 0.2 * NOISE < float(found.values["crps"][0]) < 0.6 * NOISE
    assert float(found.values["energy_score"][0]) > float(found.values["crps"][0])
    sure = score(stored, data, SCORING, "y0", CPU)
    assert float(sure.values["forecast_coverage_90"][0]) < 75, "draws without the data's noise are too sure"
    again = score(stored, data, SCORING, "y0", CPU, keep=3, noise=NOISE)
    assert np.array_equal(again.drawn.crps, found.drawn.crps) and torch.equal(again.band, found.band)
    assert "crps" not in score(stored, data, SCORING.without_draws, "y0", CPU).values


def test_the_joint_draws_keep_what_the_fit_knows_of_start_and_parameter_together(fitted):
    """A window's own forecast is known far better than the marginals of omega0 and of the start would tell."""
    stored, data = fitted
    y = torch.from_numpy(data.y[:, :OBSERVED]).movedim(1, 0).unsqueeze(1).expand(-1, 2, -1, -1)
    found = stored.model.estimate(seen(y))
    z_e, z_a, y0 = joint_draws(stored.model, found, seen(y), 400, RandomStreams([0, 1], 9))
    assert z_e.shape == (400, 2, 80, 1) and z_a.shape == (400, 2, 80, 0) and y0.shape == (400, 2, 80, 2)
    assert not torch.equal(z_e[:, 0], z_e[:, 1])
    spread = found.posterior.z_e.log_std.exp().squeeze(-1)  # in the unbounded space; nearly the same above 1 rad/s
    assert ((z_e.std(0).squeeze(-1) / spread)[:, data.z_e[:, 0] > 2] - 1).abs().mean() < 0.25
    lowered = z_e.squeeze(-1) - z_e.squeeze(-1).mean(0)
    moved = y0[..., 0] - y0[..., 0].mean(0)
    correlation = (lowered * moved).mean(0) / (lowered.std(0) * moved.std(0))
    assert correlation.abs().mean() > 0.1


def test_a_point_has_no_draws(fitted):
    stored, _ = fitted
    point = torch.ones(2, 4, 1)
    found = stored.model.estimate(seen(torch.ones(OBSERVED, 2, 4, 2)))
    q = Posterior(Delta(point), Delta(point[..., :0]))
    assert (
        joint_draws(
            stored.model.decoder, replace(found, posterior=q), seen(torch.ones(3, 2, 4, 2)), 5, RandomStreams([0], 1)
        )
        is None
    )


def test_an_encoders_gaussian_is_drawn_from_as_it_is():
    shape, parameters = (2, 4, 1), DampedPendulum().expert_parameters
    z_e = Gaussian(torch.ones(shape), torch.full(shape, -2.0), parameters)
    q = Posterior(z_e, Gaussian(torch.zeros(2, 4, 3), torch.zeros(2, 4, 3)))
    y = torch.ones(OBSERVED, 2, 4, 2)
    drawn = joint_draws(Decoder(DampedPendulum()), Estimates(y[0], *q.mean, q), seen(y), 500, RandomStreams([0, 1], 1))
    assert [d.shape for d in drawn] == [(500, 2, 4, 1), (500, 2, 4, 3), (500, 2, 4, 2)]
    assert ((drawn[0].median(0).values - z_e.mean) / z_e.mean).abs().max() < 0.05 and (drawn[0] > 0).all()
    assert (drawn[1].std(0) - 1).abs().max() < 0.2 and torch.equal(drawn[2][7], y[0])


def drawing(stored, **changed):
    told = {"count": 39, "noise": NOISE, "seeds": stored.seeds, "t": torch.from_numpy(T).float(), "begin": OBSERVED}
    return Drawing(
        **told | {"observed": OBSERVED, "start": "y0", "solver": Solver("rk4"), "draws_solver": Solver("rk4")} | changed
    )


def test_own_windows_lie_over_p_plus_and_fits_of_them_are_calibrated(fitted):
    stored, data = fitted
    made, z_e = own_draws(stored, Windows.of(data), OWN, NOISE, 60)
    assert made.y.shape == (len(T), 2, 60, 2) and z_e.shape == (2, 60, 1)
    assert z_e.min() < 0.7 and z_e.max() > 3.3 and not torch.equal(z_e[0], z_e[1])
    own, draws = of_own_windows(stored, data, OWN, NOISE, 60, drawing(stored))
    assert own.ranks.shape == (2, 60, 1) and own.tarp.shape == (2, 60) and draws == 119
    inside = np.abs(2 * own.ranks - 119) < 0.9 * 120
    assert 0.82 < inside.mean() < 0.97
    assert 0.84 < own.inside[..., 1].mean() < 0.95


def test_own_windows_take_z_a_from_so_many_training_windows_at_most(fitted, monkeypatch):
    stored, data = fitted
    asked, counts = own_windows_of.latents_of, []
    monkeypatch.setattr(own_windows_of, "WINDOWS", 7)
    monkeypatch.setattr(own_windows_of, "latents_of", lambda *told: counts.append(told[2].y.shape[2]) or asked(*told))
    made, _ = own_draws(stored, Windows.of(data), OWN, NOISE, 20)
    assert len(data) > 7 and counts == [7] and made.y.shape[2] == 20


def test_a_flow_is_ranked_on_the_draws_that_it_learns_from():
    base, data = lines()
    job = asked_of_flow({"slope": (-2.0, 2.0)}, LINE_NOISE)
    stored = prepare(base, data, job).run()
    stored.model.eval()
    own = OwnWindows(prior=job.prior)
    t = torch.from_numpy(data.t).float()
    how = drawing(stored, t=t, begin=1, observed=stored.card.observed, noise=LINE_NOISE)
    scores, draws = of_own_windows(stored, data, own, LINE_NOISE, 30, how)
    assert scores.ranks.shape == (len(stored.seeds), 30, 1) and draws == 8
    assert np.isfinite(scores.crps).all()


def test_parts_are_joined_in_order():
    one = DrawnScores(np.ones((2, 3)), np.ones((2, 3)), np.ones((2, 3, 2)))
    other = DrawnScores(np.zeros((2, 1)), np.zeros((2, 1)), np.zeros((2, 1, 2)))
    found = DrawnScores.joined([one, other])
    assert found.crps.shape == (2, 4) and found.inside[:, 3].max() == 0 and DrawnScores.joined([]) is None
    assert float(found.averages()["forecast_coverage"]["90"][0]) == 75


def test_a_first_point_that_is_not_inferred_is_the_observed_one():
    """Forecasts from the last observed point begin there."""
    data = pendulum((1.5, 3.1), n=6)
    stored = expert_alone("pendulum", data)
    stored = replace(stored, model=estimator_of(stored, None, NOISE, PRIOR))
    y = torch.from_numpy(data.y).movedim(1, 0).unsqueeze(1).expand(-1, 2, -1, -1)
    found = stored.model.estimate(seen(y[:OBSERVED]))
    states = drawing(stored, start="y_t1").states(stored.model, found, seen(y), None, RandomStreams([0, 1], 1))
    assert states.shape == (39, len(T) - OBSERVED, 2, 6, 2)
    assert (states[:, 0] - y[OBSERVED]).abs().max() < 0.5
