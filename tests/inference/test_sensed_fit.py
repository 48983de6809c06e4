"""Offsets and scales of sensors, estimated with what windows share: recovered, kept, and in what forecasts show."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from scipy import stats

import expertaug as ea
from expertaug.cli import main
from expertaug.config import load as config
from expertaug.config import report_parameters, stage_settings
from expertaug.errors import InputError, InputErrors
from expertaug.evaluation.forecasts import Forecasts
from expertaug.inference.sensed_fit import SensorCoordinates
from expertaug.models.fit_settings import Constant, SensorConstants
from expertaug.systems import Parameter, System
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories

ROOT = Path(__file__).parents[2]
T = np.arange(31) * 0.2
SCALE, OFFSET, NOISE = 0.9, 0.05, 0.02
PRIOR = {"omega0": (1.0, 3.0), "alpha": (0.01, 0.5)}
BOTH = {"omega0": "shared", "alpha": "shared"}
SENSORS = {"omega": {"scale": "shared"}, "theta": {"offset": "shared"}}
RUBBED = ea.DampedPendulum(friction="estimated")


def swings(n, seed=0, noise=NOISE, scale=SCALE, offset=OFFSET, alpha=0.15):
    """Windows of one pendulum as its sensors show them."""
    one = {"omega0": (1.7, 1.7)}, {"alpha": (alpha, alpha)}
    made = ea.simulate(ea.DampedPendulum(), *one, n=n, t=T, noise=0.0, seed=seed)
    rng = np.random.default_rng([seed, n])
    y = made.y * np.array([1.0, scale]) + np.array([offset, 0.0]) + noise * rng.normal(size=made.y.shape)
    return Trajectories(T, y, np.broadcast_to([1.7, alpha], (n, 2)).copy())


def fitted(data, sensors=SENSORS, observed_s=3.0, **options):
    options = {"units": BOTH, **options} | ({} if sensors is None else {"sensors": sensors})
    return ea.least_squares(RUBBED, data, observed_s=observed_s, prior=PRIOR, noise=NOISE, **options)


def log_mse(model, data):
    return float(model.evaluate(data).set_index("metric").value["log_mse_sum"])


@pytest.mark.slow
def test_constants_lie_within_their_intervals_as_often_as_these_say():
    held = []
    for seed in range(20):
        found = fitted(swings(14, seed), starts=8, tries=1).stored.card.refinement
        wide = stats.t.ppf(0.95, 13)
        pairs = [(found.sensors["omega"].scale, SCALE), (found.sensors["theta"].offset, OFFSET)]
        pairs += [(found.shared["omega0"], 1.7), (found.shared["alpha"], 0.15)]
        held.append([abs(one.value - true) <= wide * one.std for one, true in pairs])
        assert found.sensors["theta"].scale is None and found.sensors["omega"].offset is None
    assert np.mean(held) > 0.8 and np.mean(held, axis=0).min() > 0.7


@pytest.mark.slow
def test_forecasts_are_what_the_sensors_show_and_estimates_the_states():
    train, new = swings(20), swings(40, seed=5)
    seen, blind = fitted(train), fitted(train, sensors=None)
    assert log_mse(seen, new) < log_mse(blind, new) - 1.5
    forecast = seen.forecast(new.seen[:, : seen.observed], T)
    assert np.sqrt(np.mean((np.asarray(forecast.y) - new.y) ** 2)) < 1.5 * NOISE
    assert np.median(forecast.chi2) == pytest.approx(1.0, abs=0.2)
    assert forecast.z_e["omega0"][0] == pytest.approx(1.7, rel=0.01)
    later = seen.evaluate(new, start="y_t1").set_index("metric").value["log_mse_sum"]
    assert later < log_mse(blind, new) - 1.0  # from a single noisy state, which is corrected first


def test_fits_of_each_window_by_itself_keep_the_sensors():
    """Of the same model, refined or asked for a wider p⁺: a sensor is the data's, whatever is shared."""
    train, new = swings(14), swings(20, seed=5)
    model = fitted(train)
    alone = model.refined(noise=NOISE, prior=PRIOR).forecast(new.seen[:, : model.observed], T)
    assert np.ptp(alone.z_e["omega0"]) > 0 and np.median(alone.chi2) == pytest.approx(1.0, abs=0.25)
    assert np.median(alone.z_e["omega0"]) == pytest.approx(1.7, rel=0.02)


def test_draws_and_the_bands_made_of_them_are_what_the_sensors_show():
    train, new = swings(20), swings(60, seed=5)
    model = fitted(train)
    found = ea.predictive(model, new.seen[:, : model.observed], T)
    low, high = np.asarray(found.quantiles[0]) - 2 * NOISE, np.asarray(found.quantiles[-1]) + 2 * NOISE
    assert ((new.y >= low) & (new.y <= high)).mean() > 0.9


def test_no_sensors_are_the_same_bits():
    train = swings(10, scale=1.0, offset=0.0)
    window = train.seen[:, :16]
    one, other = (fitted(train, sensors=sensors, starts=8, tries=1, steps=6) for sensors in (None, {}))
    np.testing.assert_array_equal(one.forecast(window, T).y, other.forecast(window, T).y)
    assert one.stored.card.refinement.shared == other.stored.card.refinement.shared
    assert other.stored.card.refinement.sensors is None


def test_a_file_keeps_them_and_tables_show_them(tmp_path):
    train = swings(12)
    model = fitted(train)
    model.save(tmp_path / "model.safetensors")
    again = ea.load(tmp_path / "model.safetensors")[0]
    window = train.seen[:, : model.observed]
    np.testing.assert_array_equal(again.forecast(window, T).y, model.forecast(window, T).y)
    rows = again.estimates(train).set_index("parameter")
    assert list(rows.index) == ["omega0", "alpha", "scale of omega", "offset of theta"]
    kept = again.refinement.sensors["omega"].scale
    row = rows.loc["scale of omega"]
    assert (row.value, row.error, row.groups, row.unit) == (kept.value, kept.std, 12, "")
    assert rows.loc["offset of theta"].unit == "rad" and row.low < SCALE < row.high


def test_windows_with_gaps():
    whole = swings(20)
    rng = np.random.default_rng(0)
    mask = rng.random(whole.y.shape) > 0.2
    mask[:3, 0, 1] = False
    found = fitted(replace(whole, mask=mask)).stored.card.refinement.sensors
    assert found["omega"].scale.value == pytest.approx(SCALE, abs=4 * found["omega"].scale.std)
    assert found["theta"].offset.value == pytest.approx(OFFSET, abs=4 * found["theta"].offset.std)


CURVE = {"theta": {"quadratic": "shared", "cubic": "shared"}}


def bent(n, seed=0, quadratic=0.08, cubic=-0.1):
    """Windows of one pendulum whose angle a sensor shows that is not straight."""
    made = swings(n, seed, noise=0.0, scale=1.0, offset=0.0)
    theta = made.y[..., 0]
    y = np.stack((theta + quadratic * theta**2 + cubic * theta**3, made.y[..., 1]), -1)
    return replace(made, y=y + NOISE * np.random.default_rng(seed).normal(size=y.shape))


def test_a_sensor_that_is_not_straight_is_learned_from_the_equation():
    train, new = bent(20), bent(30, seed=5)
    straight, curved = fitted(train, sensors=None), fitted(train, sensors=CURVE)
    found = curved.stored.card.refinement.sensors["theta"]
    for name, true in (("quadratic", 0.08), ("cubic", -0.1)):
        one = getattr(found, name)
        assert one.std < 0.2 * abs(true) and one.value == pytest.approx(true, abs=3.5 * one.std), name
    assert log_mse(curved, new) < log_mse(straight, new) - 1.0
    forecast = curved.forecast(new.seen[:, : curved.observed], T)
    assert np.median(forecast.chi2) == pytest.approx(1.0, abs=0.25)
    rows = curved.estimates(train).set_index("parameter")
    assert rows.loc["quadratic of theta"].unit == "1/rad" and rows.loc["cubic of theta"].unit == "1/rad2"


def test_a_curve_that_turns_back_within_what_was_measured_is_refused():
    data = bent(12, quadratic=0.0, cubic=0.0)
    sensors = SensorCoordinates.of(RUBBED, [("theta", "cubic")], torch.from_numpy(data.y).unsqueeze(1))
    windows = torch.from_numpy(data.y).movedim(1, 0).unsqueeze(1)
    sensors.check_curves(torch.tensor([-0.01], dtype=torch.float64), windows)
    with pytest.raises(InputError, match=r"refinement\.sensors\.theta\.cubic: the curve .* turns back near theta ="):
        sensors.check_curves(torch.tensor([-1.0], dtype=torch.float64), windows)


class Spring(System):
    """x'' = −k x: a scale of both components is seen in nothing."""

    state = (Parameter("x", "m"), Parameter("v", "m/s"))
    expert_parameters = (Parameter("k", "1/s2", scale=4.0),)

    def expert(self, t, y, z_e):
        return torch.stack((y[..., 1], -z_e[..., 0] * y[..., 0]), dim=-1)


def test_constants_that_make_up_for_each_other_are_refused():
    phase = np.linspace(0, 3, 12)[:, None]
    y = np.stack((np.cos(2 * T + phase), -2 * np.sin(2 * T + phase)), -1)
    data = Trajectories(T, y + 0.01 * np.random.default_rng(0).normal(size=y.shape), np.full((12, 1), 4.0))
    given = {"observed_s": 3.0, "prior": {"k": (2.0, 6.0)}, "noise": 0.01, "units": {"k": "shared"}}
    both = {"x": {"scale": "shared"}, "v": {"scale": "shared"}}
    with pytest.raises(InputError, match=r"refinement\.sensors\.x\.scale: cannot be told apart from sensors\.v\.scale"):
        ea.least_squares(Spring(), data, sensors=both, **given)
    found = ea.least_squares(Spring(), data, sensors={"v": {"scale": "shared"}}, **given).refinement
    assert found.sensors["v"].scale.value == pytest.approx(1.0, abs=0.02)


def test_constants_that_windows_hardly_tell_are_warned_of(caplog):
    """Small swings would be the same with larger sensors and a smaller motion, but for what sin θ is less than θ."""
    true = torch.tensor([[1.7, 0.15]], dtype=torch.float64).expand(12, 2)
    start = torch.from_numpy(swings(12, noise=0.0, scale=1.0, offset=0.0).y[:, 0]).double() * 0.1
    y = Solver("dopri5", rtol=1e-8, atol=1e-8)(lambda t, y: RUBBED.expert(t, y, true), start, torch.from_numpy(T))
    y = y.movedim(0, 1).numpy() + 0.002 * np.random.default_rng(0).normal(size=(12, len(T), 2))
    both = {"theta": {"scale": "shared"}, "omega": {"scale": "shared"}}
    fitted(Trajectories(T, y, true.numpy()), both)
    assert any("sensors.omega.scale: " in line and "the windows hardly tell it" in line for line in caplog.messages)


@pytest.mark.parametrize(
    ("sensors", "says"),
    [
        ({"speed": {"scale": "shared"}}, r"sensors\.speed: 'speed' is no component of the state; known: theta, omega"),
        ({"omega": {}}, r"sensors\.omega.*names nothing; give one or some of scale, offset, quadratic, cubic: shared"),
        ({"omega": {"scale": "window"}}, r"sensors\.omega\.scale"),
        ({"omega": {"gain": "shared"}}, r"sensors\.omega\.gain"),
    ],
)
def test_sensors_that_cannot_be(sensors, says):
    with pytest.raises((InputError, InputErrors), match=says):
        fitted(swings(3), sensors=sensors)


def test_a_trained_models_refinement_does_not_guess_them():
    model = fitted(swings(6), sensors=None)
    with pytest.raises(InputError, match=r"sensors\.omega: its constants are not known"):
        model.refined(noise=NOISE, prior=PRIOR, sensors={"omega": {"scale": "shared"}})


EXPERIMENT = """
run: [swings]
seeds: [0, 1]
experiments:
  swings:
    based_on: pendulum
    data: {t1_s: 3.0, noise: 0.02}
    augmentation: {prior: {omega0: [1.0, 3.0]}}
    augmentations: {narrow: null, wide: null}
    model: {encoder: {windows: {theta: [0.0, 3.0], omega: [0.0, 3.0]}}}
    refinement: {units: {omega0: shared}, sensors: {omega: {scale: shared}}}
    methods: [least_squares, least_squares_shared]
    augmented: []
    controls: []
    flows: []
    refined: []
"""


def configured(folder, text=EXPERIMENT):
    (folder / "mine.yaml").write_text(text)
    return config.validate(config.load([ROOT / "config" / "config.yaml", folder / "mine.yaml"]))


def test_a_run_estimates_them_and_its_table_of_estimates_begins_to_tell(tmp_path):
    found = configured(tmp_path)
    for k, name in enumerate(("train", "validation")):
        one = swings(12, seed=k, offset=0.0, alpha=0.0)
        replace(one, z_e=one.z_e[:, :1]).save(tmp_path / f"{name}.npz")
    job = stage_settings.train(found, "swings", "least_squares_shared", "seeds_0_1")
    alone = stage_settings.train(found, "swings", "least_squares", "seeds_0_1")
    assert "sensors" not in alone["refinement"]["settings"]
    paths = ["--data", str(tmp_path), "--output", str(tmp_path / "model.safetensors"), "--work", str(tmp_path / "w")]
    assert main(["share", *paths, "--settings", json.dumps(job)]) == 0
    told = stage_settings.evaluate(found, "swings", "least_squares_shared", "seeds_0_1") | {"sets": ["validation"]}
    scores = ["--output", str(tmp_path / "metrics.csv"), "--forecasts", str(tmp_path / "forecasts.npz")]
    data = ["evaluate", "--model", str(tmp_path / "model.safetensors"), "--data", str(tmp_path)]
    assert main([*data, *scores, "--settings", json.dumps(told)]) == 0
    kept = Forecasts.load(tmp_path / "forecasts.npz")
    assert list(kept.sets) == ["validation"] and [one.name for one in kept.constants] == ["scale of omega"]
    metrics = pd.read_csv(tmp_path / "metrics.csv").set_index(["metric", "set"]).value
    assert (metrics["log_mse_sum", "validation"] < -5).all()
    given = json.dumps(report_parameters.estimates(found, "swings"))
    output = tmp_path / "estimates.csv"
    assert main(["estimates", str(tmp_path / "forecasts.npz"), "--output", str(output), "--settings", given]) == 0
    rows = pd.read_csv(output).set_index("parameter")
    assert list(rows.index) == ["omega0", "scale of omega"] and (rows["of"] == "all windows (shared)").all()
    assert rows.loc["scale of omega", "low"] < SCALE < rows.loc["scale of omega", "high"]


def test_a_configuration_names_components_that_there_are(tmp_path):
    with pytest.raises(
        InputErrors, match=r"refinement\.sensors\.speed: .*no component of the state; known: theta, omega"
    ):
        configured(tmp_path, EXPERIMENT.replace("{omega: {scale", "{speed: {scale"))


def test_coordinates_of_sensors_lead_back_to_their_constants():
    windows = 3 * torch.randn(5, 1, 7, 2, dtype=torch.float64)
    coordinates = SensorCoordinates.of(RUBBED, [("omega", "scale"), ("theta", "offset")], windows)
    constants = {
        "omega": SensorConstants.of(scale=Constant(value=SCALE, std=0.1)),
        "theta": SensorConstants.of(offset=Constant(value=OFFSET, std=0.1)),
    }
    x = coordinates.coordinates(constants)
    assert x.tolist() == pytest.approx([np.log(SCALE), OFFSET / float(windows[..., 0].std())])
    sensors = coordinates.sensors(x)
    assert sensors.scale.tolist() == pytest.approx([1.0, SCALE]) and sensors.offset.tolist() == [
        pytest.approx(OFFSET),
        0.0,
    ]
    again = coordinates.constants(x, torch.full((2,), 0.1, dtype=torch.float64), np.array([4, 4, 9]))
    scale, offset = again["omega"].scale, again["theta"].offset
    assert (scale.value, scale.std, scale.groups) == (pytest.approx(SCALE), pytest.approx(0.1 * SCALE), 2)
    assert offset.std == pytest.approx(0.1 * float(windows[..., 0].std()))
