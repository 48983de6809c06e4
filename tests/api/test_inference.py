"""Learning an interaction model without an encoder from Python: it forecasts, and a seed of it can be taken."""

import numpy as np
import pytest

import expertaug as ea
from expertaug.api import inference

RANGES = {"z_e": {"omega0": (1.5, 3.1)}, "z_a": {"alpha": (0.1, 0.6)}}
OPTIONS = {"steps": 2, "batch_size": 20, "validate_every": 2, "refinement": {"starts": 8, "tries": 1, "steps": 4}}


@pytest.fixture(scope="module")
def sets():
    t = np.arange(31) * 0.1
    return [
        ea.simulate(ea.DampedPendulum(), **RANGES, n=n, t=t, noise=0.01, name=name)
        for name, n in (("train", 40), ("validation", 10))
    ]


def alternate(sets, **more):
    interaction = {"kind": "mlp", "layers": [6], "activation": "silu", "components": ["omega"]}
    given = {"observed_s": 2.0, "prior": {"omega0": (0.5, 3.5)}, "noise": 0.01, **OPTIONS, **more}
    return inference.alternate(ea.DampedPendulum(), interaction, *sets, **given)


def test_forecasts_from_fits_of_each_window(sets):
    model = alternate(sets, seeds=range(2))
    train = sets[0]
    found = model.forecast(train.y[:5, :21], train.t)
    assert found.chi2.shape == (2, 5) and found.y.shape[:2] == (2, 5)
    assert np.abs(found.z_e["omega0"] - train.z_e[:5, 0]).max() < 0.6
    one = model[1].forecast(train.y[:5, :21], train.t)
    np.testing.assert_allclose(one.y, found.y[1], rtol=1e-4, atol=1e-4)


def test_what_cannot_be_used_is_said(sets):
    with pytest.raises(ea.InputError, match=r"alternation\.step"):
        alternate(sets, step=3)
    with pytest.raises(ea.InputError, match="prior"):
        alternate(sets, prior={"omega": (0.5, 3.5)})


@pytest.mark.slow
def test_a_flow_amortises_it(sets, tmp_path):
    """Learned from draws of the decoder over p⁺; forecasts then need no fit, and may be refined."""
    model, train = alternate(sets, seeds=range(2)), sets[0]
    tiny = {"steps": 30, "batch_size": 32, "pool": 64, "held_out": 32, "samples": 9, "solver": {"method": "rk4"}}
    flow = ea.fit_posterior(model, train, sets[1], prior={"omega0": (0.5, 3.5)}, noise=0.01, **tiny)
    flow.save(tmp_path / "flow.safetensors")
    again = ea.load(tmp_path / "flow.safetensors")
    y, t = train.y[:3, :21], train.t
    found = again.forecast(y, t)
    np.testing.assert_array_equal(found.y, flow.forecast(y, t).y)
    assert found.chi2 is None and found.y.shape == (2, 3, 31, 2) and again.refinement is None
    assert (found.z_e["omega0"] > 0.4).all() and (found.z_e["omega0"] < 3.6).all()
    assert ea.predictive(again, y, t, draws=9).quantiles.shape == (3, 3, 31, 2)
    refined = again.refined(noise=0.01, steps=4).forecast(y, t)
    assert refined.chi2.shape == (2, 3) and np.median(refined.chi2) < 100
    assert len(again.stored.card.misfit.validation[0]) == 10
