"""Least squares and refined models in memory, from files and from the shell."""

from __future__ import annotations

import io

import numpy as np
import pandas as pd
import pytest
import torch
from small_pendulum import OPTIONS

import expertaug as ea
from expertaug.cli import main
from expertaug.inference.coordinates import LatentCoordinates
from seen import seen

T = np.linspace(0, 4, 41)
PRIOR = {"omega0": [0.5, 3.5]}


@pytest.fixture(scope="module")
def clean():
    return ea.simulate(ea.DampedPendulum(), {"omega0": (1.0, 3.0)}, {"alpha": (0, 0)}, n=12, t=T, noise=0.01)


@pytest.fixture(scope="module")
def fitted(clean):
    return ea.least_squares(ea.DampedPendulum(), clean, observed_s=3.0, prior=PRIOR, noise=0.01)


def test_least_squares_forecasts_like_a_trained_model(clean, fitted):
    found = fitted.forecast(clean.y[:, : fitted.observed], T)
    assert found.y.shape == clean.y.shape and found.chi2.shape == (12,)
    error = np.abs(found.z_e["omega0"] - clean.z_e[:, 0])
    assert error.mean() < 0.02 and (error < 4 * found.z_e_std["omega0"]).mean() > 0.8
    table = fitted.evaluate(clean).set_index("metric")["value"]
    assert table["log_mse_sum"] < -7 and table["relative_error"] < 2
    columns = found.table().columns
    assert list(columns[-6:-1]) == ["z_e omega0 [rad/s]", "z_e omega0 std [rad/s]", "chi2", "p_chi2", "misfit"]
    assert columns[-1] == "doubtful"


def test_diffusion_is_not_taken_in_coarse_steps():
    field, t = ea.ReactionDiffusion(reaction="without_k"), np.arange(11) * 0.1
    data = ea.simulate(field, {"a": (0.001, 0.002), "b": (0.003, 0.007)}, {"k": (0, 0)}, n=3, t=t)
    fitted = ea.least_squares(field, data, observed_s=1.0, prior={"a": (0.001, 0.004), "b": (0.001, 0.01)}, starts=4)
    found = fitted.forecast(data.y, t)
    for k, name in enumerate(("a", "b")):
        np.testing.assert_allclose(found.z_e[name], data.z_e[:, k], rtol=1e-4)


def test_a_file_knows_how_it_is_fitted(clean, fitted, tmp_path, capsys):
    fitted.save(tmp_path / "model.safetensors")
    again = ea.load(tmp_path / "model.safetensors")
    window = clean.y[:, : fitted.observed]
    np.testing.assert_array_equal(again.forecast(window, T).y[0], fitted.forecast(window, T).y)
    rows = pd.DataFrame(window[0], columns=["theta", "omega"]).assign(t=T[: fitted.observed])
    rows.to_csv(tmp_path / "window.csv", index=False)
    assert main(["forecast", "--model", str(tmp_path / "model.safetensors"), str(tmp_path / "window.csv")]) == 0
    table = pd.read_csv(io.StringIO(capsys.readouterr().out))
    np.testing.assert_allclose(table["theta [rad]"], fitted.forecast(window[:1], T).y[0, :, 0], rtol=1e-4, atol=1e-5)
    assert table["chi2"].nunique() == 1


@pytest.mark.slow
def test_of_a_long_z_a_only_what_varies_most_is_sought(sets, tmp_path):
    encoder = {"kind": "recurrent", "hidden": 24, "layers": [8]}
    recipe = ea.HybridModel(ea.DampedPendulum(), encoder=encoder, interaction={"kind": "mlp", "layers": [6, 6]})
    trained = ea.fit(recipe, sets["train"], sets["validation"], observed_s=1.0, seeds=[0, 1], **OPTIONS)
    trained.save(tmp_path / "model.safetensors")
    model = ea.load(tmp_path / "model.safetensors")[1]
    latent = LatentCoordinates.of(model.stored.card, 10)
    assert latent.mean.shape == (1, 1, 24) and latent.axes.shape == (1, 10, 24) and latent.size == 10
    window = sets["train"].y[:6, : model.observed]
    y = torch.from_numpy(window).movedim(1, 0).unsqueeze(1)
    z_a = model.stored.model.encode(seen(y)).z_a.mean.detach().double()
    again = latent.z_a(latent.coordinates(z_a))
    assert (again - z_a).square().mean() < 0.05 * (z_a - latent.mean).square().mean()  # ten axes hold nearly all
    np.testing.assert_allclose(latent.coordinates(again), latent.coordinates(z_a), atol=1e-8)
    one = torch.eye(10, dtype=torch.float64)[None]
    np.testing.assert_allclose(latent.spread(one), (latent.z_a(one) - latent.mean).abs(), atol=1e-12)

    refined = model.refined(noise=0.01, prior=PRIOR)
    own, better = (m.forecast(window, sets["train"].t) for m in (model, refined))
    assert refined.predictor.fit.sizes == (1, 10, 2)
    few, whole = (model.refined(noise=0.01, prior=PRIOR, latent=n).predictor.fit for n in (3, 24))
    assert few.sizes == (1, 3, 2) and torch.equal(few.transform.latent.axes, latent.axes[:, :3])
    assert whole.sizes == (1, 24, 2) and whole.transform.latent.axes is None
    assert better.misfit.mean() < own.misfit.mean()


def test_a_trained_model_is_refined_and_stays_as_it_is(sets, fit, tmp_path, capsys):
    train, model = sets["train"], fit
    window, how = train.y[:12, : model.observed], {"noise": 0.01, "steps": 8}
    own, refined = model.forecast(window, train.t), model.refined(**how).forecast(window, train.t)
    assert refined.chi2.shape == (len(model), len(window)) and own.chi2 is None

    def misfit(forecast):
        return ((forecast.y[:, :, : model.observed] - window) ** 2).mean()

    assert misfit(refined) < misfit(own)
    one = model.refined(**how)[1].forecast(window, train.t)
    np.testing.assert_allclose(one.z_e["omega0"], refined.z_e["omega0"][1], rtol=1e-3)
    np.testing.assert_array_equal(model.forecast(window, train.t).y, own.y)
    with pytest.raises(ea.InputError, match=r"refinement\.steps"):
        model.refined(steps=0)
    model.save(tmp_path / "model.safetensors")
    pd.DataFrame(window[0], columns=["theta", "omega"]).assign(t=train.t[: model.observed]).to_csv(
        tmp_path / "w.csv", index=False
    )
    call = ["forecast", "--model", str(tmp_path / "model.safetensors"), str(tmp_path / "w.csv"), "--refine"]
    assert main([*call, "0.01"]) == 0 and "chi2" in capsys.readouterr().out
    assert main([*call, "-1"]) == 2 and "--refine: found -1" in capsys.readouterr().err


@pytest.mark.slow
def test_where_f_a_holds_is_said_of_windows_alone(fitted):
    def drawn(low, high, n, seed):
        return ea.simulate(
            ea.DampedPendulum(), {"omega0": (low, high)}, {"alpha": (0, 0)}, n=n, t=T, noise=0.01, seed=seed
        )

    train, slow = drawn(1.5, 3.0, 150, 4), drawn(0.5, 3.0, 300, 5)
    found = ea.validity(fitted, train, slow.y[:, : fitted.observed], noise=0.01, prior=PRIOR)["omega0"]
    low, high = found.holds  # without friction the expert alone holds everywhere
    assert low < 0.8 and high > 2.7 and "omega0" in found.says


def test_a_model_that_does_not_explain_its_windows_says_so(clean, fitted, caplog):
    """The noise is as stated: χ² has its distribution; with a noise of a third it has not."""
    right = fitted.forecast(clean.y[:, : fitted.observed], T)
    assert right.p_chi2.shape == (12,) and 0.01 < np.median(right.p_chi2) < 0.99
    assert "does not explain" not in caplog.text
    wrong = ea.least_squares(ea.DampedPendulum(), clean, observed_s=3.0, prior=PRIOR, noise=0.0033)
    table = wrong.forecast(clean.y[:, : fitted.observed], T).table()
    assert table["p_chi2"].max() < 1e-6
    assert "the model does not explain 12 of 12 windows to within their noise" in caplog.text


def test_without_a_noise_nothing_is_said_of_chi2(clean):
    exact = ea.least_squares(ea.DampedPendulum(), clean, observed_s=3.0, prior=PRIOR)
    assert exact.forecast(clean.y[:, : exact.observed], T).p_chi2 is None


def test_windows_outside_the_trainings_range_are_not_trusted(fit, sets, caplog):
    like, far = sets["validation"].y[:, : fit.observed].copy(), sets["validation"].y[:, : fit.observed].copy()
    far[..., 1] *= 30.0
    assert fit.forecast(like, fit.t).outside.mean() <= 0.2
    caplog.clear()
    told = fit.watched(sets["train"]).forecast(far, fit.t)
    assert told.outside.mean() >= 0.8 and not told.trusted[told.outside].any()
    assert "outside the range of the training windows'" in caplog.text
    metrics = fit.evaluate(sets["test"]).query("metric == 'outside_share'")
    assert metrics["value"].between(0, 1).all() and len(metrics) == 2
