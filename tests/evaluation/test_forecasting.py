"""Forecasts and draws of them, on a set and on windows of a model's own making."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from fitted_pendulum import NOISE, OBSERVED, PRIOR, T, expert_alone, pendulum
from known_posterior import NOISE as LINE_NOISE
from known_posterior import asked as asked_of_flow
from known_posterior import lines

from expertaug.evaluation.forecasting import Drawing, DrawnScores, forecast, of_simulations
from expertaug.inference.flow_training import prepare
from expertaug.inference.least_squares import estimator_of
from expertaug.inference.settings import OwnWindows
from expertaug.inference.simulations import draw_simulations
from expertaug.learning.random_streams import RandomStreams
from expertaug.models.decoder import MeanModel
from expertaug.systems.reaction_diffusion import ReactionDiffusion
from expertaug.systems.solvers.solver import Solver
from expertaug.windows import Windows
from seen import seen

OWN = OwnWindows(prior={"omega0": (0.5, 3.5)})


def drawing(stored, **changed):
    told = {"count": 39, "noise": NOISE, "seeds": stored.seeds, "t": torch.from_numpy(T).float(), "begin": OBSERVED}
    return Drawing(
        **told | {"observed": OBSERVED, "start": "y0", "solver": Solver("rk4"), "draws_solver": Solver("rk4")} | changed
    )


def test_own_windows_lie_over_p_plus_and_fits_of_them_are_calibrated(fitted):
    stored, data = fitted
    made, z_e = draw_simulations(stored, Windows.of(data), OWN, NOISE, 60)
    assert made.y.shape == (len(T), 2, 60, 2) and z_e.shape == (2, 60, 1)
    assert z_e.min() < 0.7 and z_e.max() > 3.3 and not torch.equal(z_e[0], z_e[1])
    own, draws = of_simulations(stored, data, OWN, NOISE, 60, drawing(stored))
    assert own.ranks.shape == (2, 60, 1) and own.tarp.shape == (2, 60) and draws == 119
    inside = np.abs(2 * own.ranks - 119) < 0.9 * 120
    assert 0.82 < inside.mean() < 0.97
    assert 0.84 < own.inside[..., 1].mean() < 0.95


def test_a_flow_is_ranked_on_the_draws_that_it_learns_from():
    base, data = lines()
    job = asked_of_flow({"slope": (-2.0, 2.0)}, LINE_NOISE)
    stored = prepare(base, data, job).run()
    stored.model.eval()
    own = OwnWindows(prior=job.prior)
    t = torch.from_numpy(data.t).float()
    how = drawing(stored, t=t, begin=1, observed=stored.card.observed, noise=LINE_NOISE)
    scores, draws = of_simulations(stored, data, own, LINE_NOISE, 30, how)
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


@pytest.mark.parametrize("count", [3, 12])
def test_the_mean_of_fields_is_forecast_for_any_number_of_windows(count):
    mean = torch.rand(5, 2, 8, 8)
    observed = torch.rand(3, 2, count, 2, 8, 8)
    windows = Windows(torch.arange(5.0), observed)
    found = forecast(MeanModel(ReactionDiffusion(), mean), windows, Solver("rk4"), "y0", None)
    assert torch.equal(found.states, mean[:, None, None].expand(5, 2, count, 2, 8, 8))
