"""Posteriors in memory: fitted, drawn from, saved, taken apart by seed."""

from __future__ import annotations

import numpy as np
import pytest
from small_pendulum import SHIFTED

import expertaug as ea
from expertaug.api.posterior import fit_posterior, predictive

TINY = {"steps": 20, "batch_size": 32, "pool": 64, "held_out": 64, "samples": 15}


@pytest.fixture(scope="module")
def flow(sets, fit):
    return fit_posterior(fit, sets["train"], prior=SHIFTED, noise=0.01, **TINY)


def test_it_forecasts_with_bands(sets, flow):
    data = sets["test"]
    window = data.y[:, : flow.observed]
    found = predictive(flow, window, data.t, draws=19)
    assert found.mean.shape == data.y.shape and found.quantiles.shape == (3, *data.y.shape)
    assert found.z_e["omega0"].shape == (38, len(data))
    low, middle, high = found.quantiles
    assert (low <= middle).all() and (middle <= high).all() and (high > low).any()
    assert (found.z_e["omega0"] > 0.3).all() and (found.z_e["omega0"] < 3.7).all()  # within p+ and its margin
    first = flow[0].forecast(window, data.t)
    np.testing.assert_allclose(first.y, flow.forecast(window, data.t).y[0], rtol=1e-2, atol=1e-3)


def test_seeds_make_one_posterior_together(sets, flow):
    data = sets["test"]
    window = data.y[:3, : flow.observed]
    each, both = (predictive(flow, window, data.t, draws=19, pooled=pooled) for pooled in (False, True))
    assert both.mean.shape == data.y[:3].shape and both.quantiles.shape == (3, *data.y[:3].shape)
    np.testing.assert_array_equal(both.z_e["omega0"], np.concatenate(each.z_e["omega0"].swapaxes(0, 1)))
    np.testing.assert_allclose(both.mean, each.mean.mean(0), rtol=1e-4, atol=1e-5)
    wide, widths = both.quantiles[2] - both.quantiles[0], each.quantiles[2] - each.quantiles[0]
    assert wide.mean() > widths.mean()


def test_a_refined_model_has_bands_too(sets, fit):
    data = sets["test"]
    found = predictive(fit.refined(noise=0.01, steps=3), data.y[:2, :11], data.t, draws=9)
    assert found.quantiles.shape == (3, 2, *data.y.shape[1:]) and (found.quantiles[0] < found.quantiles[2]).any()


def test_its_file_gives_the_same_forecasts(sets, flow, tmp_path):
    flow.save(tmp_path / "flow.safetensors")
    window = sets["test"].y[:, : flow.observed]
    again = ea.load(tmp_path / "flow.safetensors")
    np.testing.assert_array_equal(again.forecast(window, sets["test"].t).y, flow.forecast(window, sets["test"].t).y)


def test_mistakes_are_one_line(sets, fit, flow):
    window = sets["test"].y[:, : fit.observed]
    with pytest.raises(ea.InputError, match="has no draws; give one of expertaug"):
        predictive(fit, window, sets["test"].t)
    with pytest.raises(ea.InputError, match="levels: found"):
        predictive(flow, window, sets["test"].t, levels=(0.5, 1.0))
    with pytest.raises(ea.InputError, match=r"flow\.steps"):
        fit_posterior(fit, sets["train"], prior=SHIFTED, steps=0)
    with pytest.raises(ea.InputError, match="learns from a trained hybrid model"):
        fit_posterior(flow, sets["train"], prior=SHIFTED)
