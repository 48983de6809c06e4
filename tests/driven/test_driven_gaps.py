"""Driven systems of which not everything was measured: windows with gaps carry their known inputs everywhere."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from driven_sets import ENCODER, INTERACTION, OPTIONS, WIDER

import expertaug as ea
from expertaug.evaluation.forecasting import of_simulations
from expertaug.inference.diagnostics.validity import refit
from expertaug.models.fit_settings import RefinementSettings
from expertaug.models.gaps import Gaps
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows, fill
from seen import seen

START = {"omega": [-2.0, 2.0]}
PRIOR = {"omega0": (0.5, 4.0)}
CPU = torch.device("cpu")


def with_gaps(data, seed=0):
    """No speeds at all, and every fifth angle missing, also as first points."""
    mask = np.random.default_rng(seed).random(data.y.shape) > 0.2
    mask[..., 1] = False
    return replace(data, mask=mask)


@pytest.fixture(scope="module")
def gappy(sets):
    return {name: with_gaps(one, k) for k, (name, one) in enumerate(sets.items())}


@pytest.fixture(scope="module")
def fit(gappy):
    recipe = ea.HybridModel(ea.DrivenPendulum(), encoder=ENCODER, interaction=INTERACTION)
    given = gappy["train"], gappy["validation"]
    return ea.fit(recipe, *given, observed_s=0.5, start=START, seeds=[0, 1], **OPTIONS)


def test_sets_keep_inputs_and_mask_together(gappy, tmp_path):
    part = gappy["train"].subset(slice(3, 6)).window(0, 5)
    part.save(tmp_path / "part.npz")
    again = Trajectories.load(tmp_path / "part.npz")
    assert again.u.shape == (3, 5, 1) and np.array_equal(again.mask, gappy["train"].mask[3:6, :5])
    windows = Windows.of(part).until(4).joined
    assert torch.equal(torch.isnan(windows[:, 0, ..., :2]), torch.from_numpy(~part.mask[:, :4]).movedim(1, 0))
    assert torch.equal(windows[:, 0, ..., 2:], torch.from_numpy(part.u[:, :4]).movedim(1, 0))


def test_inputs_are_no_gaps_and_change_no_line(gappy):
    system = ea.DrivenPendulum()
    windows = Windows.of(gappy["train"]).until(11)
    t, middle = torch.arange(11) * 0.05, torch.tensor([0.0, 0.3])
    found = windows.filled(t, middle)
    assert torch.equal(found.u, windows.u) and torch.isfinite(found.y).all()
    assert torch.equal(fill(windows.joined, t, middle), found.joined)
    gaps = Gaps(system, t, {"theta": [-2, 2], **START})
    assert torch.equal(gaps.start(windows), gaps.start(seen(windows.y)))


def test_it_is_trained_forecast_and_scored(fit, gappy):
    test = gappy["test"]
    window, t = test.seen[:, : fit.observed], test.t
    found = fit.forecast(window, t, u=test.u)
    assert np.isfinite(found.y).all() and np.isfinite(found.misfit).all()
    other = fit.forecast(window, t, u=test.u + 5.0)
    assert not np.allclose(found.y, other.y) and not np.allclose(found.z_e["omega0"], other.z_e["omega0"])
    known = test.mask[:, 0, 0]
    assert np.array_equal(found.y[0][known, 0, 0], test.y[known, 0, 0]) and (~known).any()
    table = fit.evaluate(test).set_index(["seed", "metric"])["value"]
    assert np.isfinite(table).all() and (0, "log_mse_sum") in table.index
    assert len(fit.stored.card.misfit.validation[0]) == len(gappy["validation"])


def test_augmented_samples_have_inputs_and_gaps_of_their_window(fit, gappy):
    given = fit, gappy["train"], gappy["validation"]
    for options in ({}, {"worst": 0.5}):
        drawn = ea.augment(*given, prior=WIDER, noise={"theta": 0.01, "omega": 0.02}, **options).train[1]
        points = len(drawn.t)
        assert np.array_equal(drawn.u, gappy["train"].u[:, :points])
        assert np.array_equal(drawn.mask, gappy["train"].mask[:, :points])
    plus = ea.finetune(*given, prior=WIDER, noise=0.01, **OPTIONS)
    assert np.isfinite(plus.evaluate(gappy["test"])["value"]).all()


@pytest.mark.slow
def test_windows_are_fitted_and_drawn_from(fit, gappy):
    test = gappy["test"]
    window = test.seen[:, : fit.observed]
    refined = fit.refined(noise=0.01, prior=PRIOR, starts=8, tries=1)
    found, before = (one.forecast(window, test.t, u=test.u) for one in (refined, fit))
    assert np.isfinite(found.chi2).all() and np.nanmedian(found.misfit) < np.nanmedian(before.misfit)
    band = ea.predictive(refined, window, test.t, u=test.u, draws=9)
    assert np.isfinite(band.quantiles).all()
    windows = Windows.of(test).until(fit.observed)
    changed = refit(refined.stored, windows, 0.01, PRIOR, RefinementSettings(starts=8, tries=1))
    assert torch.isfinite(changed.change()).all() and torch.isfinite(changed.chi2_after).all()


@pytest.mark.slow
def test_ranges_are_found_with_and_without_windows(fit, gappy):
    test = gappy["test"]
    options = {"noise": 0.01, "prior": PRIOR, "starts": 8, "tries": 1}
    given = ea.own_prior(fit, gappy["train"], test.seen[:, : fit.observed], u=test.u[:, : fit.observed], **options)
    without = ea.own_prior(fit, gappy["train"], budget=1.5, **options)
    for found in (given, without):
        low, high = found.ranges["omega0"]
        assert 0 < low < high
    with pytest.raises(ea.InputError, match="has the known inputs"):
        ea.own_prior(fit, gappy["train"], test.seen[:, : fit.observed], **options)


@pytest.mark.slow
def test_drawn_forecasts_are_scored_where_something_was_measured(fit, gappy):
    from expertaug.evaluation.forecasting import drawing_of
    from expertaug.evaluation.score import score
    from expertaug.evaluation.settings import Scoring
    from expertaug.inference.settings import OwnWindows

    untold = replace(gappy["test"], mask=gappy["test"].mask.copy())
    untold.mask[2, fit.observed :] = False
    untold = replace(untold, mask=untold.mask)
    refined = fit.refined(noise=0.01, prior=PRIOR, starts=8, tries=1)
    stored = replace(fit.stored, model=refined.predictor)
    scoring = Scoring(draws=9, drawn_samples=10)
    scored = score(stored, untold, scoring, "y0", CPU, keep=2, noise=0.01)
    assert np.isnan(scored.drawn.crps[:, 2]).all() and np.isfinite(np.delete(scored.drawn.crps, 2, 1)).all()
    assert np.isfinite(scored.values["crps"]).all() and np.isfinite(scored.values["forecast_coverage_90"]).all()
    drawing = drawing_of(stored, scoring, 0.01, gappy["train"].t, "y0", CPU)
    own, _ = of_simulations(stored, gappy["train"], OwnWindows(prior=PRIOR), 0.01, 6, drawing)
    assert own.ranks.shape[1] == own.crps.shape[1] > 0


@pytest.mark.slow
def test_a_flow_and_an_alternating_training_take_them(fit, gappy):
    test, given = gappy["test"], (gappy["train"], gappy["validation"])
    window = test.seen[:, : fit.observed]
    small = {"steps": 4, "pool": 64, "held_out": 16, "batch_size": 16}
    flow = ea.fit_posterior(fit, *given, prior=PRIOR, noise=0.01, **small)
    assert np.isfinite(flow.forecast(window, test.t, u=test.u).y).all()
    options = {"steps": 3, "batch_size": 10, "latent": 1, "refinement": {"starts": 8, "tries": 1}}
    system = ea.DrivenPendulum()
    found = ea.alternate(system, INTERACTION, *given, observed_s=0.5, prior=PRIOR, noise=0.01, start=START, **options)
    assert np.isfinite(found.forecast(window, test.t, u=test.u).y).all()
    alone = ea.least_squares(system, gappy["train"], observed_s=0.5, prior=PRIOR, noise=0.01, start=START, starts=8)
    assert np.isfinite(alone.forecast(window, test.t, u=test.u).y).all()
