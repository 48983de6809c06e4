"""config/measurements.yaml, which users copy: its columns, its splits, and a double pendulum that is calibrated."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from expertaug.cli import main
from expertaug.config import jobs, recording_settings, stage_settings
from expertaug.config import load as config
from expertaug.errors import InputErrors
from expertaug.systems.double_pendulum import Constants
from expertaug.trajectories import Trajectories
from expertaug_recordings.rendering.motion import simulate
from nightly import others_slow

ROOT = Path(__file__).parents[2]
CONSTANTS, FRICTION = Constants(B1=0.4, G1=62.0, B2=1.28, G2=72.6), (0.03, 0.02)
EXAMPLE = [ROOT / "config" / "config.yaml", ROOT / "config" / "measurements.yaml"]
REAL = ROOT.parent / "shared" / "measurements"


def completed(folder: Path, run: str, **data: object) -> dict:
    """The example's configuration with its files in a folder."""
    given = config.load(EXAMPLE)
    for one in ("real_pendulum", "real_double_pendulum"):
        files = given["experiments"][one]["data"]["files"]
        files["paths"] = str(folder / Path(files["paths"]).name)
    given["experiments"][run].setdefault("data", {}).update(data)
    return config.validate({**given, "run": [run]})


def double_pendulum(folder: Path) -> Path:
    """Ten trials of three seconds, whole turns included, of which a tenth of the rows is lost."""
    rng, t = np.random.default_rng(0), np.arange(300) / 100
    start = rng.uniform([-2, -2, -8, -15], [2, 2, 8, 15], size=(10, 4))
    y = simulate(start, t, CONSTANTS, FRICTION) + rng.normal(0, [5e-4, 5e-4, 5e-3, 5e-3], size=(10, 300, 4))
    rows = [[k, t[i], *y[k, i], 0, 0, 0, 0] for k in range(10) for i in range(300) if rng.random() > 0.1]
    path = folder / "real_double_pend_h_1.txt"
    np.savetxt(path, rows, header="o1 o2 w1 w2", comments="% ")
    return path


@pytest.mark.slow
def test_a_double_pendulum_of_a_table_is_calibrated(tmp_path):
    table = double_pendulum(tmp_path)
    found = completed(tmp_path, "real_double_pendulum")
    one, data = "real_double_pendulum", tmp_path / "data"
    cut = ["cut-measurements", str(table), "--output", str(data)]
    assert main([*cut, "--settings", json.dumps(recording_settings.cut_measurements(found, one))]) == 0
    train = Trajectories.load(data / "train.npz")
    assert not train.mask.all(), "with gaps"
    np.testing.assert_array_equal(train.z_e[train.mask[:, 0, 2], 0], train.y[train.mask[:, 0, 2], 0, 2])
    told = recording_settings.calibrate(found, one).model_dump_json()
    output = tmp_path / "calibration.json"
    assert main(["calibrate", str(data / "train.npz"), "--output", str(output), "--settings", told]) == 0
    report = json.loads(output.read_text())
    fitted = report["with_friction"]["constants"]
    for name, value in CONSTANTS.to_dict().items():
        assert fitted[name] == pytest.approx(value, rel=0.01), name
    assert report["with_friction"]["train_log_mse"] < -9 and report["implied_rate_hz"] is None


@pytest.mark.slow
def test_only_what_was_measured_whole_is_calibrated(tmp_path):
    double_pendulum(tmp_path)
    files = config.load(EXAMPLE)["experiments"]["real_double_pendulum"]["data"]["files"]
    files |= {"paths": str(tmp_path / "*.txt"), "columns": {"theta1": "o1", "theta2": "o2"}, "z_e": {}}
    start = {"omega1": [-9, 9], "omega2": [-9, 9]}
    with pytest.raises(InputErrors, match=r"data\.calibrate: found true; only a double pendulum of which all four"):
        completed(tmp_path, "real_double_pendulum", files=files, start=start)


def test_losses_of_energy_are_compared_where_all_was_measured(tmp_path):
    """Of both pendulums; not where the speed is inferred, nor of simulations."""
    (tmp_path / "real_pend_h_1.txt").write_text("% t\n0 5.0 1.1 .9\n0 5.2 1.2 .7\n")
    found = completed(tmp_path, "real_pendulum")
    assert {"aphynity", "hvae", "aphynity~refined"} <= set(jobs.dissipating(found, "real_pendulum"))
    del found.experiments["real_pendulum"].data.files.columns["omega"]
    assert jobs.dissipating(found, "real_pendulum") == []
    default = config.validate(config.load(EXAMPLE[:1]))
    assert jobs.dissipating(default, "pendulum") == [] and jobs.dissipating(default, "double_pendulum")


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_dir(), reason="needs the measurements beside the checkout, ../shared/measurements")
@pytest.mark.parametrize(
    ("one", "method", "score"),
    others_slow(
        [
            ("real_pendulum", "least_squares_shared", -5.81),
            ("real_pendulum", "friction_sensors", -7.92),
            ("real_pendulum_small", "friction_sensors", -8.81),
            ("real_pendulum", "friction_shared", -6.45),
            ("real_pendulum_small", "friction_shared", -6.65),
            ("real_pendulum", "friction_population", -8.05),
            ("real_pendulum_small", "friction_population", -8.88),
        ],
        2,
    ),
)
def test_constants_that_windows_share_explain_the_real_pendulum(tmp_path, one, method, score):
    found = completed(REAL, one)
    settings = json.dumps(recording_settings.cut_measurements(found, one))
    table = found.experiments[one].data.files.paths
    assert main(["cut-measurements", str(table), "--output", str(tmp_path), "--settings", settings]) == 0
    group = next(iter(jobs.seed_groups(found)))
    model, scores = tmp_path / "model.safetensors", tmp_path / "metrics.csv"
    job = ["--data", str(tmp_path), "--settings", json.dumps(stage_settings.train(found, one, method, group))]
    assert main(["share", *job, "--output", str(model), "--work", str(tmp_path / "work")]) == 0
    told = stage_settings.evaluate(found, one, method, group)
    told["evaluation"] |= {"draws": 0, "expected_draws": 0}
    job = ["--data", str(tmp_path), "--settings", json.dumps(told), "--model", str(model), "--output", str(scores)]
    assert main(["evaluate", *job, "--forecasts", str(tmp_path / "forecasts.npz")]) == 0
    rows = pd.read_csv(scores).query("set == 'test' and metric == 'log_mse_sum'")
    assert rows["value"].to_numpy() == pytest.approx(score, abs=0.005)


@pytest.mark.skipif(not REAL.is_dir(), reason="needs the measurements beside the checkout, ../shared/measurements")
def test_the_files_that_it_is_made_for(tmp_path):
    """Small swings train, large ones test; the double pendulum's constants explain its motion."""
    for one in ("real_pendulum", "real_double_pendulum"):
        found = completed(REAL, one)
        table = found.experiments[one].data.files.paths
        data = tmp_path / one
        settings = json.dumps(recording_settings.cut_measurements(found, one))
        assert main(["cut-measurements", str(table), "--output", str(data), "--settings", settings]) == 0
        sets = {name: Trajectories.load(data / f"{name}.npz") for name in ("train", "test")}
        if one == "real_pendulum":
            assert np.abs(sets["train"].y).max() < 1.1 < np.abs(sets["test"].y[..., 0]).max(axis=1).min()
            continue
        told = recording_settings.calibrate(found, one).model_dump_json()
        output = data / "calibration.json"
        assert main(["calibrate", str(data / "train.npz"), "--output", str(output), "--settings", told]) == 0
        report = json.loads(output.read_text())
        assert min(report["r2_1"], report["r2_2"]) > 0.999 and report["train_log_mse"] < -9
