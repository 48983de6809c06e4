"""Everything that simulates through a model takes the known inputs along."""

import numpy as np
import pandas as pd
import pytest
import torch
from driven_sets import ENCODER, FREQUENCY, OPTIONS, WIDER, T, simulated

import expertaug as ea
from expertaug.cli import main
from expertaug.errors import InputError
from nightly import others_slow


class Own(torch.nn.Module):
    """An F_a of plain PyTorch that sees the torque and the time."""

    sees_inputs = sees_time = True

    def __init__(self, system, latent):
        super().__init__()
        self.net = torch.nn.Linear(2 + latent + 2, 2)

    def forward(self, y, z_a, known):
        assert known.shape[-1] == 2
        return 0.01 * self.net(torch.cat((y, z_a, known / 20), dim=-1))


class Flat(torch.nn.Module):
    """An encoder of plain PyTorch, which sees states and inputs."""

    def __init__(self, system, times):
        super().__init__()
        assert [p.name for p in system.state] == ["theta", "omega", "torque"]
        self.net = torch.nn.Linear(3 * len(times), 1)

    def forward(self, observed):
        return self.net(observed.movedim(0, 1).flatten(1))


def window(data):
    return data.y[:, :11]


def test_it_trains_is_saved_and_forecasts(fit, plus, sets, tmp_path):
    test = sets["test"]
    assert np.isfinite(fit.history["value"]).all()
    for model in (fit, plus):
        found = model.forecast(window(test), test.t, u=test.u)
        assert found.y.shape == (2, 10, 21, 2) and np.isfinite(found.y).all()
        model.save(tmp_path / "model.safetensors")
        again = ea.load(tmp_path / "model.safetensors")
        assert np.array_equal(again.forecast(window(test), test.t, u=test.u).y, found.y)
        assert again.stored.card.inputs == [["torque", ""]]
    table = plus.evaluate(test)
    assert np.isfinite(table["value"]).all()
    onwards = fit.forecast(window(test), test.t, u=test.u, start="y_t1")
    assert np.array_equal(onwards.y[0, :, :11], window(test))


def test_a_forecast_follows_the_torque_after_the_window(fit, sets):
    test, other = sets["test"], sets["test"].u.copy()
    other[:, 11:] = 0.0
    one, two = (fit[0].forecast(window(test), test.t, u=u) for u in (test.u, other))
    assert np.array_equal(one.z_e["omega0"], two.z_e["omega0"])
    assert np.allclose(one.y[:, :11], two.y[:, :11], atol=1e-5) and np.abs(one.y[:, 12:] - two.y[:, 12:]).max() > 0.1


def test_encoders_see_the_torque(fit, sets):
    test = sets["test"]
    one = fit[0].estimate(window(test), test.t, u=test.u)["omega0"]
    other = fit[0].estimate(window(test), test.t, u=test.u[::-1].copy())["omega0"]
    assert np.abs(one - other).max() > 1e-4


def test_augmented_samples_have_the_torque_of_the_windows_they_start_from(fit, sets):
    drawn = ea.augment(fit, sets["train"], sets["validation"], prior=WIDER)
    for one in drawn.train:
        assert np.array_equal(one.u, sets["train"].u[:, :11])
        assert np.array_equal(one.y[:, 0], sets["train"].y[:, 0])


def test_least_squares_finds_the_frequency_of_a_driven_pendulum():
    sets = {
        name: ea.simulate(ea.DrivenPendulum(), FREQUENCY, {"gamma": (0, 0)}, n=8, t=T, name=name,
                          inputs={"A": (5, 40), "f": (3.14, 6.28)})
        for name in ("train", "test")
    }  # fmt: skip
    model = ea.least_squares(ea.DrivenPendulum(), sets["train"], observed_s=0.5, prior=WIDER)
    test = sets["test"]
    found = model.forecast(window(test), test.t, u=test.u)
    assert np.abs(found.z_e["omega0"] / test.z_e[:, 0] - 1).max() < 1e-3
    assert np.abs(found.y - test.y).max() < 0.02


@pytest.mark.slow
def test_refined_estimates_a_prior_of_its_own_and_validity(fit, sets):
    test, seen = sets["test"], sets["test"].window(0, 11)
    refined = fit.refined(noise=0.01, prior=WIDER, starts=4, tries=1, steps=3)
    assert np.isfinite(refined.forecast(window(test), test.t, u=test.u).y).all()
    options = {"u": seen.u, "noise": 0.01, "prior": WIDER, "starts": 4, "tries": 1, "steps": 3}
    assert "omega0" in ea.own_prior(fit, sets["train"], seen.y, **options).ranges
    assert "omega0" in ea.validity(fit, sets["train"], seen.y, **options)


@pytest.mark.slow
def test_alternation(sets):
    model = ea.alternate(
        ea.DrivenPendulum(), {"kind": "mlp", "layers": [6], "inputs": True, "time": True}, sets["train"],
        sets["validation"], observed_s=0.5, prior=WIDER, noise=0.01, steps=4, batch_size=10, validate_every=2,
        refinement={"starts": 4, "tries": 1},
    )  # fmt: skip
    test = sets["test"]
    assert np.isfinite(model.forecast(window(test), test.t, u=test.u).y).all()


@pytest.mark.slow
def test_a_flow_and_its_bands(fit, sets, tmp_path):
    options = {"steps": 10, "pool": 40, "uses": 1, "held_out": 20, "samples": 8, "batch_size": 10}
    flow = ea.fit_posterior(fit, sets["train"], prior=WIDER, noise=0.01, **options)
    test = sets["test"]
    band = ea.predictive(flow, window(test), test.t, u=test.u, draws=8)
    assert band.mean.shape == (10, 21, 2) and np.isfinite(band.quantiles).all()
    assert np.isfinite(flow.forecast(window(test), test.t, u=test.u).y).all()
    other = ea.predictive(flow, window(test), test.t, u=np.zeros_like(test.u), draws=8)
    assert np.abs(band.mean - other.mean).max() > 0.1


@pytest.mark.parametrize("windows", others_slow([{"theta": [0.0, 0.5], "torque": [0.0, 0.5]}, None]))
def test_the_hybrid_vae(sets, windows):
    encoder = {"kind": "two_step", "latent_layers": [6], "filter_layers": [6], "expert_layers": [6], "windows": windows}
    recipe = ea.HybridModel(ea.DrivenPendulum(), encoder, {"kind": "mlp", "layers": [6], "inputs": True})
    model = ea.fit(
        recipe, sets["train"], sets["validation"], observed_s=0.5, objective=ea.HybridVAE, prior=WIDER, **OPTIONS
    )
    assert np.isfinite(model.evaluate(sets["test"])["value"]).all()


@pytest.mark.slow
@pytest.mark.parametrize("interaction", others_slow([Own, {"kind": "damping", "components": ["omega"]}]))
def test_own_parts_and_those_that_see_no_inputs(sets, interaction):
    recipe = ea.HybridModel(ea.DrivenPendulum(), Flat, interaction)
    model = ea.fit(recipe, sets["train"], sets["validation"], observed_s=0.5, seeds=[0, 1], **OPTIONS)
    assert np.isfinite(model.evaluate(sets["test"])["value"]).all()


def test_the_mean_of_the_training_set_and_figures(fit, sets):
    assert ea.plots.forecasts(fit, sets["test"]) and ea.plots.parameters(fit, sets["test"])


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda m, d: m.forecast(window(d), d.t), "u: missing; DrivenPendulum has the known inputs torque"),
        (lambda m, d: m.forecast(window(d), d.t, u=d.u[:, :11]), "u: has shape (10, 11, 1); give (10, 21, 1)"),
        (lambda m, d: m.evaluate(ea.Trajectories(d.t, d.y, d.z_e)), "u: missing"),
        (lambda m, d: ea.finetune(m, ea.Trajectories(d.t, d.y, d.z_e), d, prior=WIDER), "train.u: missing"),
        (lambda m, d: m.forecast(window(d), d.t, u=np.zeros((10, 21, 3))), "u has 3 components"),
    ],
)
def test_a_window_without_its_inputs_is_one_line(fit, sets, call, expected):
    with pytest.raises(InputError) as found:
        call(fit, sets["test"])
    assert expected in str(found.value) and "\n" not in str(found.value)


def test_a_system_without_inputs_takes_none(sets):
    free = ea.simulate(ea.DampedPendulum(), FREQUENCY, {"alpha": (0, 1)}, n=5, t=T)
    given = ea.Trajectories(free.t, free.y, free.z_e, u=np.zeros((5, 21, 1)))
    recipe = ea.HybridModel(ea.DampedPendulum(), ENCODER)
    with pytest.raises(InputError, match=r"train.u: u has 1 components; DampedPendulum has none"):
        ea.fit(recipe, given, given, observed_s=0.5, **OPTIONS)
    with pytest.raises(InputError, match="DampedPendulum has no known inputs"):
        recipe = ea.HybridModel(ea.DampedPendulum(), ENCODER, {"kind": "mlp", "inputs": True})
        ea.fit(recipe, free, free, observed_s=0.5, **OPTIONS)


def table(data, rows, sample=0):
    columns = {"sample": sample, "t [s]": data.t, "theta [rad]": data.y[sample, :, 0]}
    columns |= {"omega [rad/s]": data.y[sample, :, 1], "torque": data.u[sample, :, 0]}
    found = pd.DataFrame(columns)
    found.loc[11:, ["theta [rad]", "omega [rad/s]"]] = np.nan
    return found[:rows]


def test_the_command_reads_inputs_as_columns(fit, sets, tmp_path, capsys):
    test = simulated("test", 10)
    fit.save(tmp_path / "model.safetensors")
    file = tmp_path / "window.csv"
    pd.concat([table(test, 21, 0), table(test, 21, 3)]).to_csv(file, index=False)
    command = ["forecast", "--model", str(tmp_path / "model.safetensors"), "--seed", "1", str(file)]
    assert main([*command, "--output", str(tmp_path / "out.csv")]) == 0
    found = pd.read_csv(tmp_path / "out.csv")
    expected = fit[1].forecast(window(test)[[0, 3]], test.t, u=test.u[[0, 3]])
    assert np.allclose(found["theta [rad]"].to_numpy().reshape(2, 21), expected.y[..., 0], atol=1e-6)
    assert main([*command, "--t-end", "0.7", "--output", str(tmp_path / "out.csv")]) == 0
    assert pd.read_csv(tmp_path / "out.csv")["t [s]"].max() == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("change", "more", "expected"),
    [
        (lambda t: t.drop(columns="torque"), [], "no column torque"),
        (lambda t: t[:11], [], "gives torque up to 0.5 s; add rows with t and torque, the states empty"),
        (lambda t: t, ["--t-end", "3"], "gives torque up to 1 s; add rows with t and torque"),
        (lambda t: t.assign(torque=t["torque"].where(t.index != 15)), [], "column torque, row 16: nan"),
    ],
)
def test_a_file_without_its_inputs_is_one_line(fit, sets, tmp_path, capsys, change, more, expected):
    fit.save(tmp_path / "model.safetensors")
    change(table(sets["test"], 21)).to_csv(tmp_path / "window.csv", index=False)
    assert main(["forecast", "--model", str(tmp_path / "model.safetensors"), *more, str(tmp_path / "window.csv")]) == 2
    assert expected in capsys.readouterr().err
