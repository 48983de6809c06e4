"""expertaug forecast: a CSV of windows in, a CSV of states and estimates out."""

import io
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from small_pendulum import FRICTION, OPTIONS, SEEN, T

import expertaug as ea
from expertaug.cli import main


@pytest.fixture(scope="module")
def model(fit, tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "model.safetensors"
    fit.save(path)
    return path


def window(sets, samples=(0,), step=1.0):
    parts = [
        pd.DataFrame({"sample": f"w{k}", "t": T[:11] * step, "theta": y[:, 0], "omega [rad/s]": y[:, 1]})
        for k, y in ((k, sets["test"].y[k, :11]) for k in samples)
    ]
    return pd.concat(parts)


def run(capsys, model, table, folder, *options):
    table.to_csv(folder / "window.csv", index=False)
    status = main(["forecast", "--model", str(model), str(folder / "window.csv"), *options])
    return status, capsys.readouterr()


def test_it_prints_states_and_estimates_of_every_seed_with_units(fit, model, sets, tmp_path, capsys):
    status, told = run(capsys, model, window(sets, (2, 5)), tmp_path)
    assert status == 0
    table = pd.read_csv(io.StringIO(told.out))
    states = ["seed", "sample", "t [s]", "theta [rad]", "omega [rad/s]"]
    assert list(table.columns) == [
        *states,
        "z_e omega0 [rad/s]",
        "misfit",
        "outside",
    ]  # ten validation windows give no threshold
    assert len(table) == 2 * 2 * 21 and list(table["sample"].unique()) == ["w2", "w5"]
    found = fit.forecast(sets["test"].y[[2, 5], :11], T)
    one = table[(table["seed"] == 1) & (table["sample"] == "w5")]
    np.testing.assert_allclose(one[["theta [rad]", "omega [rad/s]"]], found.y[1, 1], rtol=1e-6)
    np.testing.assert_allclose(one["z_e omega0 [rad/s]"], found.z_e["omega0"][1, 1], rtol=1e-6)


def test_the_median_of_the_seeds_is_one_forecast(fit, model, sets, tmp_path, capsys):
    status, told = run(capsys, model, window(sets, (2, 5)), tmp_path, "--seed", "median")
    assert status == 0
    table = pd.read_csv(io.StringIO(told.out))
    states = ["theta [rad]", "theta std [rad]", "omega [rad/s]", "omega std [rad/s]"]
    assert list(table.columns) == ["sample", "t [s]", *states, "z_e omega0 [rad/s]", "misfit", "outside"]
    each = fit.forecast(sets["test"].y[[2, 5], :11], T)
    of_window = table[table["sample"] == "w5"]
    np.testing.assert_allclose(of_window["omega [rad/s]"], np.median(each.y[:, 1, :, 1], 0), rtol=1e-6)
    np.testing.assert_allclose(of_window["omega std [rad/s]"], each.y[:, 1, :, 1].std(0, ddof=1), rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(of_window["z_e omega0 [rad/s]"], np.median(each.z_e["omega0"], 0)[1], rtol=1e-6)
    assert fit[0].forecast(sets["test"].y[:1, :11], T).median().y_std is None, "one seed is its own median"


def test_a_seed_that_could_not_be_trained_is_not_printed(fit, sets, tmp_path, capsys):
    path = tmp_path / "failed.safetensors"
    replace(fit, stored=replace(fit.stored, card=fit.stored.card.but(failed=[0]))).save(path)
    status, told = run(capsys, path, window(sets), tmp_path)
    assert status == 0 and set(pd.read_csv(io.StringIO(told.out))["seed"]) == {1}
    assert "left out, since they could not be trained: seeds 0" in told.err
    status, told = run(capsys, path, window(sets), tmp_path, "--seed", "0")
    assert status == 2 and "seed 0 could not be trained; it has 1" in told.err
    replace(fit, stored=replace(fit.stored, card=fit.stored.card.but(failed=[0, 1]))).save(path)
    status, told = run(capsys, path, window(sets), tmp_path)
    assert status == 2 and "none of its seeds could be trained; train it again" in told.err


def test_one_seed_until_a_later_time_into_a_file(model, sets, tmp_path, capsys):
    options = ("--output", str(tmp_path / "out.csv"), "--seed", "1", "--t-end", "3.05")
    status, told = run(capsys, model, window(sets).drop(columns="sample"), tmp_path, *options)
    assert status == 0 and told.out == ""
    table = pd.read_csv(tmp_path / "out.csv")
    assert set(table["seed"]) == {1} and table["t [s]"].tolist() == pytest.approx((np.arange(31) * 0.1).tolist())
    status, _ = run(capsys, model, window(sets), tmp_path, *options[:-1], "1.25")
    assert status == 0 and pd.read_csv(tmp_path / "out.csv")["t [s]"].max() == pytest.approx(1.2)


@pytest.mark.parametrize(
    ("change", "options", "expected"),
    [
        (lambda w: w.drop(columns="theta"), (), "no column theta; it has sample, t, omega"),
        (
            lambda w: w.rename(columns={"theta": "theta [deg]"}),
            (),
            "theta [deg]; the model's unit is theta [rad]",
        ),
        (lambda w: w.assign(t=w["t"] * 2), (), "has the times 0, 0.2"),
        (lambda w: w[:9], (), "has 9 points a window; the model observes 11, t = 0 … 1 s"),
        (lambda w: w[:0], (), "has no rows"),
        (lambda w: w.assign(theta=["x", *w["theta"][1:]]), (), "column theta, row 1: x; give finite numbers"),
        (lambda w: w.assign(theta=np.nan), (), "column theta, row 1"),
        (lambda w: pd.concat((w, w.assign(sample="b", t=w["t"] + 1))), (), "window 2 has other times"),
        (lambda w: w, ("--seed", "7"), "no seed 7; it has 0, 1"),
        (lambda w: w, ("--t-end", "0.5"), "--t-end: found 0.5; the observed window ends at 1 s"),
        (lambda w: w, ("--t-end", "1e9"), "--t-end: 1e+09 s is"),
        (lambda w: w, ("--output", "/dev/null/x.csv"), "cannot be written"),
    ],
)
def test_mistakes_are_one_line_and_status_2(model, sets, tmp_path, capsys, change, options, expected):
    status, told = run(capsys, model, change(window(sets)), tmp_path, *options)
    lines = told.err.strip().splitlines()
    assert status == 2 and len(lines) == 1 and lines[0].startswith("expertaug forecast: ") and expected in lines[0]
    assert told.out == ""


def test_files_that_are_none(model, tmp_path, capsys):
    for path, text in ((tmp_path / "none.csv", "no such file"), (tmp_path, "no CSV"), (model, "no CSV")):
        assert main(["forecast", "--model", str(model), str(path)]) == 2
        assert text in capsys.readouterr().err
    assert main(["forecast", "--model", str(tmp_path / "m"), str(model)]) == 2
    assert "no such file" in capsys.readouterr().err


def test_an_alarm_from_validation_windows_is_a_column_and_a_line(fit, model, sets, tmp_path, capsys):
    """The threshold is of the given set; a window that moves otherwise than any of them is told."""
    validation = ea.simulate(ea.DampedPendulum(), SEEN, FRICTION, n=40, t=T, noise=0.01, name="validation")
    validation.save(tmp_path / "validation.npz")
    odd = window(sets, (2, 5))
    odd.loc[odd["sample"] == "w5", "theta"] = np.resize([9.0, -9.0], 11)
    status, told = run(capsys, model, odd, tmp_path, "--validation", str(tmp_path / "validation.npz"))
    assert status == 0
    table = pd.read_csv(io.StringIO(told.out))
    assert not table.loc[table["sample"] == "w5", "trusted"].any()
    assert table.loc[table["sample"] == "w2", "trusted"].all()
    lines = [line for line in told.err.splitlines() if "trusted is False" in line]
    assert len(lines) == 1 and lines[0].startswith("1 of 2 windows")


@pytest.mark.slow
def test_a_model_keeps_what_it_needs_for_the_alarm(sets, recipe, tmp_path):
    many = ea.simulate(ea.DampedPendulum(), SEEN, FRICTION, n=40, t=T, noise=0.01, name="validation")
    model = ea.fit(recipe, sets["train"], many, observed_s=1.0, seeds=[0, 1], **OPTIONS)
    model.save(tmp_path / "m.safetensors")
    again = ea.load(tmp_path / "m.safetensors")
    found = again.forecast(many.y[:, :11], T)
    assert found.trusted.shape == (2, 40) and found.trusted.mean() >= 0.95
    squares = ((found.y[:, :, 1:11] - many.y[:, 1:11]) ** 2).sum(-1).mean(-1)
    np.testing.assert_allclose(found.misfit, squares, rtol=1e-4)
    one = again[1].forecast(many.y[:, :11], T)
    np.testing.assert_array_equal(one.trusted, found.trusted[1])
    assert again.forecast(many.y[:, :11], T, start="y_t1").misfit is None
    refined = again.refined(noise=0.01)
    assert refined.forecast(many.y[:3, :11], T).trusted is None, "other estimates, other misfits"
    watched = refined.watched(many).forecast(many.y[:3, :11], T)
    np.testing.assert_array_equal(watched.trusted, ~watched.outside)  # as well explained, and where F_a was learned
