"""Parameters that all windows share: the minimum and its errors, and forecasts that have them."""

import copy
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from rubbed_pendulum import BOTH, END, EXPERIMENT, NOISE, PRIOR, Rubbed, T, fitted, swings
from scipy.optimize import least_squares

import expertaug as ea
from expertaug.cli import main
from expertaug.config import load as config
from expertaug.config import stage_settings
from expertaug.errors import InputError
from expertaug.inference.shared import groups_of, on_training_windows
from expertaug.models.fit_settings import Refinement, RefinementSettings
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories


@pytest.mark.slow
def test_it_is_the_minimum_over_everything_at_once():
    data = swings(5)
    found = fitted(data, units=BOTH).stored.card.refinement.shared
    t = torch.from_numpy(T)  # all of the training windows

    def residuals(x):
        z_e = torch.from_numpy(np.broadcast_to(x[:2], (5, 2)).copy())
        y = Solver("rk4", substeps=2)(lambda s, y: Rubbed().expert(s, y, z_e), torch.from_numpy(x[2:].reshape(5, 2)), t)
        return ((y.movedim(1, 0).numpy() - data.y) / NOISE).ravel()

    best = least_squares(residuals, np.concatenate(([1.6, 0.1], data.y[:, 0].astype(float).ravel())))
    assert [found["omega0"].value, found["alpha"].value] == pytest.approx(best.x[:2], rel=2e-4)


@pytest.mark.slow
def test_standard_errors_are_as_large_as_the_errors():
    scores = []
    for seed in range(24):
        found = fitted(swings(20, seed), units=BOTH).stored.card.refinement.shared
        scores.append([(found[k].value - v) / found[k].std for k, v in (("omega0", 1.7), ("alpha", 0.15))])
    assert np.all(np.abs(np.std(scores, axis=0) - 1) < 0.45)
    assert np.all(np.abs(np.mean(scores, axis=0)) < 0.8)


@pytest.mark.slow
def test_forecasts_of_one_pendulum_gain_from_all_of_its_windows():
    train, new = swings(20), swings(50, seed=9)
    errors = {}
    for name, units in (("window", {}), ("omega0", {"omega0": "shared"}), ("both", BOTH)):
        model = fitted(train, **({"units": units} if units else {}))
        errors[name] = float(model.evaluate(new).set_index("metric").value["log_mse_sum"])
        forecast = model.forecast(new.seen[:, : model.observed], T)
        assert np.ptp(forecast.z_e["omega0"]) == 0 if units else np.ptp(forecast.z_e["omega0"]) > 0
    assert errors["both"] < errors["omega0"] < errors["window"] - 0.2


def test_what_is_not_shared_stays_each_windows_own():
    alpha = np.linspace(0.05, 0.4, 20)
    data = swings(20, alpha=alpha, noise=0.002, t=np.arange(61) * 0.1)
    model = fitted(data, units={"omega0": "shared"})
    found = model.forecast(data.seen[:, : model.observed], data.t)
    assert np.corrcoef(found.z_e["alpha"], alpha)[0, 1] > 0.99
    assert found.z_e_std["omega0"] == pytest.approx(model.stored.card.refinement.shared["omega0"].std, rel=1e-3)


def test_a_file_keeps_them(tmp_path):
    train = swings(6)
    model = fitted(train, units=BOTH)
    model.save(tmp_path / "model.safetensors")
    again = ea.load(tmp_path / "model.safetensors", classes=[Rubbed])
    window = train.seen[:, : model.observed]
    np.testing.assert_array_equal(again[0].forecast(window, T).y, model.forecast(window, T).y)
    assert again.stored.card.refinement.shared == model.stored.card.refinement.shared


def test_noise_free_first_points_leave_nothing_to_fit():
    train = swings(6, noise=0.0)
    model = ea.least_squares(Rubbed(), train, observed_s=END, prior=PRIOR, units=BOTH)
    forecast = model.forecast(train.seen[:, : model.observed], T)
    assert np.abs(np.asarray(forecast.y) - train.y).max() < 1e-2


@pytest.mark.parametrize(
    ("units", "says"),
    [({"omega": "shared"}, r"units\.omega: 'omega' is no expert parameter"), ({"omega0": "everyone"}, "units.omega0")],
)
def test_units_that_cannot_be(units, says):
    with pytest.raises(InputError, match=says):
        fitted(swings(3), units=units)


@pytest.fixture(scope="module")
def trained():
    """A hybrid model, two seeds of it, whose F_a has learned next to nothing."""
    sets = [replace(data, z_e=data.z_e[:, :1]) for data in (swings(10, 3, alpha=0.0), swings(4, 4, alpha=0.0))]
    encoder = {"kind": "recurrent", "hidden": 4, "layers": [4]}
    interaction = {"kind": "mlp", "layers": [4], "components": ["omega"], "start": 0.001}
    recipe = ea.HybridModel(ea.DampedPendulum(), encoder, interaction)
    return ea.fit(recipe, *sets, observed_s=END, seeds=(0, 1), epochs=1, batch_size=5)


def test_windows_of_one_apparatus_refine_a_trained_model_together(trained):
    """One constant for each seed's F_a, in which all windows agree."""
    data = swings(12, seed=7, omega0=1.3, alpha=0.0)
    data = replace(data, z_e=data.z_e[:, :1])
    each = trained.refined(noise=NOISE, prior={"omega0": (1.0, 3.0)})
    one = each.together(data, units={"omega0": "shared"})
    constant, window = one.refinement.shared["omega0"], data.seen[:, : trained.observed]
    assert constant.seeds == pytest.approx([1.3, 1.3], abs=0.03) and constant.std < 0.02
    alone, shared = (m.estimate(window, T[: trained.observed])["omega0"] for m in (each, one))
    assert np.ptp(shared, axis=1) == pytest.approx(0.0, abs=1e-6)
    assert np.abs(shared - 1.3).max() < np.abs(alone - 1.3).max()
    with pytest.raises(InputError, match="are no fits of windows; give least squares, or an alternating or refined"):
        trained.together(data, units={"omega0": "shared"})


def test_a_seed_that_failed_has_the_others_constant(trained):
    model, data = copy.deepcopy(trained.stored.model), swings(6, seed=7, omega0=1.3, alpha=0.0)
    for parameter in model.parameters():
        parameter.data[1] = torch.nan
    stored = replace(trained.stored, model=model, card=trained.stored.card.but(failed=[1]))
    settings = RefinementSettings(units={"omega0": "shared"})
    how = Refinement.of(settings=settings, noise=NOISE, prior={"omega0": [1.0, 3.0]})
    both, alone = (on_training_windows(s, how, data).shared["omega0"] for s in (stored, trained[0].stored))
    assert both.seeds == [both.value, both.value] and both.value == alone.value and both.error == alone.std


def test_a_trained_models_refinement_does_not_share_in_silence():
    model = fitted(swings(6))
    with pytest.raises(InputError, match=r"units\.omega0: shared, and its value is not known"):
        model.refined(noise=NOISE, prior=PRIOR, units={"omega0": "shared"})


def test_errors_are_clustered_by_trajectory_or_by_blocks():
    data = swings(40)
    by_trajectory = replace(data, id=np.array([f"run{k // 4}/{k}" for k in range(40)]))
    assert len(set(groups_of(by_trajectory))) == 10
    assert len(set(groups_of(replace(data, id=np.array([f"run/{k}" for k in range(40)]))))) == 10
    assert len(set(groups_of(data))) == 40


def test_the_stage_fits_what_python_fits(tmp_path, capsys):
    """And its file forecasts with these constants."""
    (tmp_path / "mine.yaml").write_text(EXPERIMENT)
    root = Path(__file__).parents[2]
    found = config.validate(config.load([root / "config" / "config.yaml", tmp_path / "mine.yaml"]))
    rng = np.random.default_rng(3)
    for name in ("train", "validation"):
        one = swings(12, int(rng.integers(99)))
        replace(one, z_e=one.z_e[:, :1]).save(tmp_path / f"{name}.npz")
    job = stage_settings.train(found, "swings", "least_squares_shared", "seeds_0_1")
    paths = ["--data", str(tmp_path), "--output", str(tmp_path / "model.safetensors"), "--work", str(tmp_path / "w")]
    assert main(["share", *paths, "--settings", json.dumps(job)]) == 0
    model = ea.load(tmp_path / "model.safetensors")
    train = Trajectories.load(tmp_path / "train.npz")
    options = {"prior": {"omega0": (1.0, 3.0)}, "noise": NOISE, "units": {"omega0": "shared"}}
    options["solver"] = job["training"]["solver"]
    same = ea.least_squares(ea.DampedPendulum(), train, observed_s=END, **options)
    one, other = (each.stored.card.refinement.shared["omega0"] for each in (model, same))
    assert (one.value, one.std) == pytest.approx((other.value, other.std), rel=1e-9)
    window = train.seen[:, : same.observed]
    np.testing.assert_allclose(model.forecast(window, T).y[1], same.forecast(window, T).y, atol=1e-4)
    told = stage_settings.evaluate(found, "swings", "least_squares_shared", "seeds_0_1") | {"sets": ["validation"]}
    scores = ["--output", str(tmp_path / "metrics.csv"), "--forecasts", str(tmp_path / "forecasts.npz")]
    data = ["evaluate", "--model", str(tmp_path / "model.safetensors"), "--data", str(tmp_path)]
    assert main([*data, *scores, "--settings", json.dumps(told)]) == 0
    estimates = np.load(tmp_path / "forecasts.npz")["validation_z_e_hat"]
    assert np.ptp(estimates, axis=(0, 1)).max() == 0
    del job["refinement"]["settings"]["units"]
    assert main(["share", *paths, "--settings", json.dumps(job)]) == 2
    assert "refinement.units: nothing is shared" in capsys.readouterr().err


def test_windows_of_one_apparatus_are_fitted_together():
    """The constant's error falls with their number, and nothing after the observed window is looked at."""
    each = fitted(swings(4))
    found = {}
    for count in (1, 4, 16):
        data = swings(count, seed=7, omega0=1.2)
        cut = replace(data, y=data.y[:, : each.observed], t=T[: each.observed])
        one = each.together(cut, units={"omega0": "shared"})
        found[count] = one.refinement.shared["omega0"]
    later = replace(data, y=np.where(T[:, None] <= END, data.y, 9.0).astype(np.float32))
    assert each.together(later, units={"omega0": "shared"}).refinement.shared == one.refinement.shared
    assert abs(found[16].value - 1.2) < 3 * found[16].std
    assert found[16].std < min(found[4].std, 0.5 * found[1].std)
    estimates = one.estimate(cut.y, cut.t)["omega0"]
    assert np.ptp(estimates) == 0 and estimates[0] == pytest.approx(found[16].value)


def test_what_cannot_be_fitted_together_is_refused():
    model = fitted(swings(4))
    with pytest.raises(InputError, match="units: nothing is shared"):
        model.together(swings(4))
    with pytest.raises(InputError, match="no expert parameter"):
        model.together(swings(4), units={"mass": "shared"})


@pytest.mark.parametrize(("substeps", "coarse"), [(1, True), (8, False)])
def test_steps_that_are_too_coarse_for_the_noise_are_told(caplog, substeps, coarse):
    data = swings(12)
    part = replace(data, t=data.t[::4], y=data.y[:, ::4])  # .8 s of a period of 3.7 s
    solver = {"method": "rk4", "substeps": substeps}
    model = ea.least_squares(Rubbed(), part, observed_s=4.8, prior=PRIOR, noise=NOISE, solver=solver)
    for _ in range(2):
        model.estimate(part.seen[:, : model.observed], part.t[: model.observed])
    told = [line for line in caplog.messages if "steps are too coarse" in line]
    assert len(told) == coarse and all("{substeps: " in line for line in told)


def test_coarse_steps_are_told_once_and_not_of_each_trajectory(caplog):
    data = swings(6)
    part = replace(data, t=data.t[::4], y=data.y[:, ::4], id=np.array([f"p{k}/0" for k in range(6)]))
    how = {"observed_s": 4.8, "prior": PRIOR, "noise": NOISE, "units": {"omega0": "trajectory"}}
    model = ea.least_squares(Rubbed(), part, **how)
    caplog.clear()
    model.estimates(part)
    assert len([line for line in caplog.messages if "steps are too coarse" in line]) == 1
