"""What a parameter belongs to beside all windows: trajectories, and a distribution that windows are draws of."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from rubbed_pendulum import END, NOISE, PRIOR, Rubbed, T, fitted, swings

import expertaug as ea
from expertaug.errors import InputError
from expertaug.evaluation.forecasts import Forecasts, constants_of
from expertaug.inference.population import PopulationPull, correlation_time, distribution
from expertaug.models.fit_settings import Constant, Population
from nightly import others_slow

BOTH = {"omega0": "trajectory", "alpha": "shared"}
OMEGA0 = np.array([1.6, 2.0, 2.4])


def told(rng, count, spread, weakest=0.05, strongest=0.5):
    """What units tell of two parameters, N(1, spread) and N(−2, .3), with errors of their own."""
    true = np.array([1.0, -2.0]) + rng.normal(size=(count, 2)) * [spread, 0.3]
    error = rng.uniform(weakest, strongest, size=(count, 2))
    curvature = np.zeros((count, 2, 2))
    curvature[:, [0, 1], [0, 1]] = error**-2.0
    slope = -(error**-2.0) * (true + error * rng.normal(size=(count, 2)) - 1.7)  # taken somewhere else
    return (*map(torch.from_numpy, (curvature, slope)), torch.full((count, 2), 1.7, dtype=torch.float64))


@pytest.mark.parametrize("spread", others_slow([0.4, 0.0]))
def test_mean_and_spread_are_found_with_errors_of_their_size(spread):
    scores, spreads = [], []
    for seed in range(16):
        curvature, slope, at = told(np.random.default_rng(seed), 40, spread)
        one = distribution(curvature, slope, at, torch.arange(40))
        scores.append((one.mean - torch.tensor([1.0, -2.0])) / one.mean_std)
        spreads.append(torch.cat((one.spread, one.spread_std)))
    scores, spreads = torch.stack(scores), torch.stack(spreads).mean(0)
    assert (scores.std(0) - 1).abs().max() < 0.5 and scores.mean(0).abs().max() < 0.7
    assert spreads[:2] == pytest.approx([spread, 0.3], abs=0.04)
    assert 0.02 < spreads[2] < 0.1


def test_units_of_one_cluster_tell_less_of_the_mean():
    rng = np.random.default_rng(3)
    curvature, slope, at = (part.repeat_interleave(10, dim=0) for part in told(rng, 8, 0.4))
    alone = distribution(curvature, slope, at, torch.arange(80))
    together = distribution(curvature, slope, at, torch.arange(8).repeat_interleave(10))
    assert (together.mean_std > 2 * alone.mean_std).all() and torch.equal(together.mean, alone.mean)


def test_correlation_times():
    rng = np.random.default_rng(0)
    white = torch.from_numpy(rng.normal(size=(200, 60, 2)))
    assert correlation_time(white) < 1.5
    slow = white.clone()
    for k in range(1, 60):
        slow[:, k] = 0.8 * slow[:, k - 1] + 0.6 * white[:, k]
    assert correlation_time(slow) == pytest.approx(1.8 / 0.2, rel=0.25)


def test_a_lognormal_pull_is_of_the_logarithm_and_seeds_have_their_own():
    middle = Constant(value=0.2, seeds=[0.1, 0.3], std=0.0)
    one = Population(form="lognormal", middle=middle, spread=Constant(value=0.5, std=0.1), unit="window")
    pull = PopulationPull.of(Rubbed(), {"alpha": one})
    residuals = pull.residuals(torch.tensor([[[2.0, 0.1]], [[2.0, 0.3 * np.e]]], dtype=torch.float64))
    assert residuals.flatten().tolist() == pytest.approx([0.0, 1 / np.hypot(0.5, 0.1)])


def several(count, seed, low=0.02, high=0.5):
    rng = np.random.default_rng(seed)
    return swings(count, seed, rng.uniform(1.4, 2.4, count), rng.uniform(low, high, count))


def log_mse(model, data):
    return float(model.evaluate(data).set_index("metric").value["log_mse_sum"])


@pytest.fixture(scope="module")
def pulled():
    return fitted(several(60, 1), population={"alpha": "normal"})


@pytest.mark.slow
def test_a_distribution_helps_windows_that_tell_little(pulled):
    train, new = several(60, 1), several(60, 2)
    found = pulled.refinement.population["alpha"]
    assert found.middle.value == pytest.approx(train.z_e[:, 1].mean(), abs=0.02)
    assert found.spread.value == pytest.approx(train.z_e[:, 1].std(), rel=0.2)
    each = fitted(train)
    assert log_mse(pulled, new) < log_mse(each, new) + 0.05
    errors = {}
    for name, model in {"each": each, "pulled": pulled}.items():
        forecast = model.forecast(new.seen[:, : model.observed], T)
        errors[name] = forecast.z_e["alpha"] - new.z_e[:, 1]
        inside = np.abs(errors[name]) < 1.645 * forecast.z_e_std["alpha"]
        assert 0.78 < inside.mean() < 0.98, name
    assert np.sqrt((errors["pulled"] ** 2).mean()) < 0.9 * np.sqrt((errors["each"] ** 2).mean())


def test_a_file_keeps_distributions_and_estimates_tell_them(tmp_path, pulled):
    pulled.save(tmp_path / "model.safetensors")
    again, new = ea.load(tmp_path / "model.safetensors", classes=[Rubbed]), several(5, 3)
    window = new.seen[:, : pulled.observed]
    np.testing.assert_array_equal(again[0].forecast(window, T).y, pulled.forecast(window, T).y)
    table = pulled.estimates(new).set_index(["parameter", "of"])
    row, one = table.loc[("alpha", "windows (population)")], pulled.refinement.population["alpha"]
    assert (row.value, row.error, row.spread) == (one.middle.value, one.middle.std, one.spread.value)
    assert list(table.loc["alpha"].index) == ["windows (population)"], "pulled windows are not averaged as well"


@pytest.mark.slow
def test_spreads_of_nothing_are_found_to_be_nothing():
    train = swings(30)
    model = fitted(train, population={"omega0": "lognormal", "alpha": "normal"})
    found = model.refinement.population
    assert found["omega0"].spread.value < 2e-3 and found["alpha"].spread.value < 5e-3
    shared = fitted(train, units={"omega0": "shared", "alpha": "shared"})
    assert log_mse(model, swings(30, seed=9)) == pytest.approx(log_mse(shared, swings(30, seed=9)), abs=0.03)


def of_pendulums(omega0, windows, seed, alpha=0.15):
    data = swings(len(omega0) * windows, seed, np.repeat(omega0, windows), alpha)
    names = [f"p{k}/{row}" for k in range(len(omega0)) for row in range(0, windows * len(T), len(T))]
    return replace(data, id=np.array(names))


@pytest.mark.slow
def test_windows_of_a_trajectory_share_its_value_and_errors_are_as_large_as_errors():
    scores = []
    for seed in range(3):
        omega0 = np.random.default_rng(seed).normal(2.0, 0.25, 8)
        model = fitted(of_pendulums(omega0, 4, seed), units=BOTH, population={"omega0": "normal"})
        each = model.refinement.trajectories["omega0"]
        scores += [(each[f"p{k}"].value - omega0[k]) / each[f"p{k}"].std for k in range(8)]
        found = model.refinement.population["omega0"]
        assert abs(found.middle.value - omega0.mean()) < 0.2 * found.middle.std, "of these eight it is known"
        assert found.unit == "trajectory" and found.middle.groups == 8
    assert 0.6 < np.std(scores) < 1.5


@pytest.fixture(scope="module")
def tied():
    """Windows of three pendulums, and a fit in which each has its own frequency and all have one friction."""
    data = of_pendulums(OMEGA0, 6, 1)
    return data, fitted(data, units=BOTH)


def test_a_window_of_a_known_trajectory_has_its_value(tied):
    _, model = tied
    later = of_pendulums(OMEGA0, 5, 2)
    window, names = later.seen[:, : model.observed], later.trajectories
    known, unknown = model.forecast(window, T, of=names), model.forecast(window, T)
    constants = model.refinement.trajectories["omega0"]
    assert known.z_e["omega0"] == pytest.approx([constants[name].value for name in names], rel=2e-3)
    assert np.ptp(unknown.z_e["omega0"][:5]) > 2e-3
    assert model.estimate(window, T[: model.observed], of=names)["omega0"] == pytest.approx(known.z_e["omega0"])
    assert log_mse(model, later) < log_mse(model, replace(later, id=None)) - 0.1
    mixed = np.where(np.arange(len(names)) % 2, names, "elsewhere")
    some = model.forecast(window, T, of=mixed).z_e["omega0"]
    assert some[1::2] == pytest.approx(known.z_e["omega0"][1::2], abs=1e-6)
    assert some[::2] == pytest.approx(unknown.z_e["omega0"][::2], abs=1e-6)
    with pytest.raises(InputError, match="of: 2 names for 15 windows"):
        model.forecast(window, T, of=names[:2])


def test_estimates_name_trajectories_once(tied, tmp_path):
    data, model = tied
    table = model.estimates(data)
    rows = table[table.parameter == "omega0"].set_index("of")
    assert sorted(rows.index) == ["all", "p0", "p1", "p2"] and list(rows.loc[["p0", "p1"]].windows) == [6, 6]
    assert rows.loc["all"].spread == pytest.approx(0.4, rel=0.3)
    constants = constants_of(model.refinement, {"omega0": "rad/s", "alpha": "1/s"}, {})
    forecasts = Forecasts(T, 10, [0], [], [], [], [], {}, constants=constants)
    forecasts.save(tmp_path / "forecasts.npz")
    again = Forecasts.load(tmp_path / "forecasts.npz").constants
    assert [str(one) for one in again] == [str(one) for one in constants] and len(again) == 3


def test_an_apparatus_is_a_draw_of_the_training_distribution(pulled):
    swings_of_one = swings(6, 8, 1.9, 0.2)
    one = pulled.together(swings_of_one, units={"omega0": "shared"})
    assert one.refinement.population == pulled.refinement.population
    assert one.refinement.shared["omega0"].value == pytest.approx(1.9, abs=0.01)
    both = pulled.together(swings_of_one, units={"omega0": "shared", "alpha": "shared"})
    assert not both.refinement.population and both.refinement.shared["alpha"].value == pytest.approx(0.2, abs=0.02)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"population": {"omega": "normal"}}, r"population\.omega: 'omega' is no expert parameter"),
        ({"population": {"alpha": "uniform"}}, r"population\.alpha"),
        ({"population": {"alpha": "normal"}, "units": {"alpha": "shared"}}, r"population\.alpha: is shared by all"),
    ],
)
def test_distributions_that_cannot_be(options, says):
    with pytest.raises(InputError, match=says):
        fitted(swings(3), **options)


def test_a_trained_models_refinement_has_no_distribution_in_silence():
    with pytest.raises(InputError, match=r"population\.alpha: its distribution is not known"):
        fitted(swings(6)).refined(noise=NOISE, prior=PRIOR, population={"alpha": "normal"})


@pytest.mark.slow
def test_alternation_has_a_distribution_of_each_seed():
    rng = np.random.default_rng(0)
    train, new = (swings(40, seed, rng.uniform(1.4, 2.4, 40), 0.15) for seed in (1, 2))
    train, new = (replace(one, z_e=one.z_e[:, :1]) for one in (train, new))
    pendulum = ea.DampedPendulum()
    model = ea.alternate(
        pendulum,
        {"kind": "damping", "components": ["omega"]},
        train,
        new,
        observed_s=END,
        prior={"omega0": (1.0, 3.0)},
        noise=NOISE,
        seeds=(0, 1),
        steps=20,
        latent=0,
        batch_size=20,
        refinement={"population": {"omega0": "normal"}},
    )
    found = model.refinement.population["omega0"]
    assert len(found.middle.seeds) == 2 and found.spread.value == pytest.approx(train.z_e.std(), rel=0.25)
    first = model[0].refinement.population["omega0"].middle
    assert first.value == found.middle.seeds[0] and model.forecast(new.seen[:, : model.observed], T).y.shape[0] == 2


def test_one_trajectory_has_no_distribution():
    with pytest.raises(InputError, match=r"population\.omega0: one trajectory has no distribution"):
        fitted(of_pendulums(np.array([2.0]), 6, 1), units=BOTH, population={"omega0": "normal"})


@pytest.mark.slow
def test_windows_of_unknown_trajectories_are_each_their_own():
    data = several(12, 4)
    options = {"population": {"omega0": "normal"}, "units": {"alpha": "shared"}}
    alone = fitted(data, **options)
    tied = fitted(data, **(options | {"units": BOTH}))
    assert tied.refinement.trajectories is None
    assert tied.refinement.population == alone.refinement.population
