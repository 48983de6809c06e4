import json

import numpy as np
import pytest
from pendulum_motion import CONSTANTS, FRICTION, markers, real_recordings, truth

from expertaug.errors import InputError
from expertaug.systems.double_pendulum import Constants, point_masses
from expertaug.trajectories import Trajectories
from expertaug_recordings.angles.calibration import forecast_log_mse
from expertaug_recordings.angles.calibration import run_stage as calibrate
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.angles.pendulum_fit import fit_constants, implied_rate
from expertaug_recordings.chunks import split_chunks
from expertaug_recordings.ibm import import_markers, list_marker_files
from expertaug_recordings.settings import CalibrateJob, ImportMarkersJob, MeasureAnglesJob, SplitChunksJob


def clean_chunks(noise=0.0, seed=0):
    """Chunks of 20 points at 100 Hz from the slower parts of the true motion."""
    y = truth()[:, 6000::4]
    y = y[:, : y.shape[1] // 20 * 20].reshape(-1, 20, 4).copy()
    y[..., :2] -= 2 * np.pi * np.round(y[:, :1, :2] / (2 * np.pi))
    y += noise * np.array([1, 2, 50, 100]) * np.random.default_rng(seed).normal(size=y.shape)
    return Trajectories(np.arange(20) / 100, y, y[:, 0, 2:])


def relative(found, wanted):
    return max(abs(a / b - 1) for a, b in zip(found.to_dict().values(), wanted.to_dict().values(), strict=True))


def test_fit_of_exact_motion():
    fit = fit_constants(truth()[0], 0.01, friction=True, every=4)
    assert relative(fit.constants, CONSTANTS) < 1e-3
    assert fit.friction == pytest.approx(FRICTION, rel=0.01)
    assert min(fit.r2) > 0.99999
    assert list(fit.std_errors) == ["B1", "G1", "B2", "G2", "friction1", "friction2"]


def test_spans_over_missing_points_are_left_out():
    y = truth()[:, ::4].copy()
    y[:, 1000:1100] = np.nan
    y[:, 1100:, 1] += 14 * np.pi  # another branch after the gap
    assert relative(fit_constants(y, 0.01, friction=True).constants, CONSTANTS) < 1e-3


def test_standard_errors_are_those_of_repeated_measurements():
    fits = [fit_constants(clean_chunks(0.001, seed).y, 0.01, friction=True) for seed in range(40)]
    for name in ("G1", "B2"):
        spread = np.std([getattr(f.constants, name) for f in fits], ddof=1)
        assert np.mean([f.std_errors[name] for f in fits]) == pytest.approx(spread, rel=0.4)


def test_noisy_speeds_hardly_bias_the_fit():
    """Speeds of .1 and .2 rad/s noise, ten times those of the recordings."""
    fit = fit_constants(clean_chunks(noise=0.002).y, 0.01, friction=True)
    assert relative(fit.constants, CONSTANTS) < 0.01


def test_log_mse_is_that_of_sines_and_cosines():
    chunks = clean_chunks()
    predicted = chunks.y[:, :1, :2] + chunks.t[:, None] * chunks.y[:, :1, 2:]
    truth_ = chunks.y[..., :2]
    squares = (np.sin(predicted) - np.sin(truth_)) ** 2 + (np.cos(predicted) - np.cos(truth_)) ** 2
    assert forecast_log_mse(chunks, None) == pytest.approx(np.log(squares.mean()), abs=1e-4)


def test_implied_rate_of_stretched_time():
    true = point_masses(0.091, 0.070, mass_ratio=0.15)
    stretched = Constants(true.B1, true.G1 / 1.25**2, true.B2, true.G2 / 1.25**2)
    assert implied_rate(stretched, 400, 0.091) == pytest.approx(500)


def test_calibrate(tmp_path):
    clean_chunks(noise=0.0002).save(tmp_path / "train.npz")
    calibrate(tmp_path / "train.npz", tmp_path / "calibration.json", CalibrateJob(rate_provenance="x"))
    report = json.loads((tmp_path / "calibration.json").read_text())
    assert relative(Constants(**report["constants"]), CONSTANTS) < 0.02
    rubbed = report["with_friction"]
    assert relative(Constants(**rubbed["constants"]), CONSTANTS) < 0.005
    assert rubbed["friction"] == pytest.approx(FRICTION, abs=0.02)
    assert rubbed["train_log_mse"] < report["train_log_mse"]
    assert report["rate_provenance"] == "x" and report["implied_rate_hz"] == pytest.approx(400 * 1.254, rel=0.01)


def test_calibrate_refuses_what_is_no_set_of_chunks(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        calibrate(tmp_path / "train.npz", tmp_path / "calibration.json", CalibrateJob())
    clean_chunks().subset(slice(0, 5)).save(tmp_path / "train.npz")
    with pytest.raises(InputError, match="at least 10 chunks"):
        calibrate(tmp_path / "train.npz", tmp_path / "calibration.json", CalibrateJob())
    still = Trajectories(np.arange(20) / 100, np.zeros((20, 20, 4)), np.zeros((20, 2)))
    still.save(tmp_path / "train.npz")
    with pytest.raises(InputError, match="do not determine"):
        calibrate(tmp_path / "train.npz", tmp_path / "calibration.json", CalibrateJob())
    assert not (tmp_path / "calibration.json").exists()


def measured(folder, paths):
    for name, table in paths.items():
        (folder / name).mkdir()
        table.to_csv(folder / name / "markers.csv", index=False)
        measure_angles(*(folder / name / f for f in ("markers.csv", "angles.csv", "angles.json")), MeasureAnglesJob())
    return [folder / name / "angles.csv" for name in paths]


@pytest.mark.slow
def test_from_markers_to_constants(tmp_path):
    angles = measured(tmp_path, {f"r{k}": markers(y, seed=k) for k, y in enumerate(truth())})
    split_chunks(angles, tmp_path / "data", SplitChunksJob(stride=20))
    calibrate(tmp_path / "data" / "train.npz", tmp_path / "data" / "calibration.json", CalibrateJob())
    report = json.loads((tmp_path / "data" / "calibration.json").read_text())
    assert relative(Constants(**report["with_friction"]["constants"]), CONSTANTS) < 0.003


@pytest.mark.slow
def test_real_recordings_reproduce_the_known_forecast_errors(tmp_path):
    """The facts' table by time, on the recordings that are here; the compound fits must be at least as good."""
    angles = []
    for name, path in list_marker_files(real_recordings()).items():
        import_markers(path, tmp_path / name / "markers.csv", ImportMarkersJob())
        measure_angles(*(tmp_path / name / f for f in ("markers.csv", "angles.csv", "angles.json")), MeasureAnglesJob())
        angles.append(tmp_path / name / "angles.csv")
    split_chunks(angles, tmp_path / "data", SplitChunksJob(by="time", phases="first", stride=20))
    calibrate(tmp_path / "data" / "train.npz", tmp_path / "data" / "calibration.json", CalibrateJob())
    report = json.loads((tmp_path / "data" / "calibration.json").read_text())
    sets = [Trajectories.load(tmp_path / "data" / f"{name}.npz") for name in ("train", "validation", "test")]
    rubbed = report["with_friction"]
    table = {
        "constant speed": [forecast_log_mse(s, None) for s in sets],
        "point masses": [forecast_log_mse(s, point_masses(0.091, 0.070)) for s in sets],
        "compound": [forecast_log_mse(s, Constants(**report["constants"])) for s in sets],
        "friction": [forecast_log_mse(s, Constants(**rubbed["constants"]), tuple(rubbed["friction"])) for s in sets],
    }
    assert table["constant speed"] == pytest.approx([-1.7, -1.2, -0.9], abs=0.1)
    assert table["point masses"] == pytest.approx([-2.3, -1.7, -1.1], abs=0.15)
    assert np.all(np.array(table["compound"]) < [-8.2, -7.7, -7.0])
    assert np.all(np.array(table["friction"]) < [-9.2, -8.9, -8.0])
    assert 498 < report["implied_rate_hz"] < 503
