"""What the angles' uncertainty is made of besides noise, and which columns hold what was corrected."""

import warnings

import numpy as np
import pandas as pd
import pytest
from pendulum_motion import MARKERS, markers, truth

from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.angles.pendulum_fit import Gravity, direction_error
from expertaug_recordings.angles.summary import RecordingSummary
from expertaug_recordings.reports.page import _heading, correct_lengths
from expertaug_recordings.reports.page import run_stage as plot_recording
from expertaug_recordings.settings import MeasureAnglesJob
from nightly import others_slow

ANGLES = ["theta1", "theta2"]


def measure(folder, table, **settings):
    files = [folder / name for name in ("markers.csv", "angles.csv", "angles.json")]
    table.to_csv(files[0], index=False)
    measure_angles(*files, MeasureAnglesJob(**settings))
    return pd.read_csv(files[1]), RecordingSummary.load(files[2])


@pytest.mark.parametrize(("every", "tilt"), others_slow([(4, -0.2), (1, 0.15), (8, 0.3), (13, 0.1)]))
def test_the_direction_of_gravity_is_part_of_each_angle_s_uncertainty(tmp_path, every, tilt):
    y = truth()[0, : 600 * every : every]
    angles, summary = measure(tmp_path, markers(y, 400 / every), rotation_deg=tilt)
    good = angles["quality"] == 1
    off = np.rad2deg(np.angle(np.exp(1j * (angles[ANGLES].to_numpy() - y[:, :2]))))[good]
    stated = np.rad2deg(angles[["theta1_std", "theta2_std"]].to_numpy())[good]
    ratio = np.sqrt(np.mean(stated**2, 0) / np.mean(off**2, 0))
    assert ((ratio > 1 / 1.5) & (ratio < 1.5)).all(), ratio
    assert summary.rotation_error_deg == pytest.approx(abs(tilt), rel=0.35)
    assert summary.uncertainty1_deg > summary.rotation_error_deg * 0.99
    assert "uncertain by 0" in " ".join(_heading(summary).split())
    exact, summary = measure(tmp_path, markers(y, 400 / every), rotation_deg=tilt, rotation_error_deg=0.0)
    assert summary.rotation_error_deg == 0 and (exact["theta1_std"][good] < angles["theta1_std"][good]).all()


def test_what_is_known_of_the_stated_direction_and_what_the_motion_says_go_together():
    assert direction_error(Gravity(0.2, 0.01), None, False) == pytest.approx(0.2, abs=1e-3)
    assert direction_error(Gravity(0.2, 0.15), None, False) == 0  # the motion does not contradict the image's down
    assert direction_error(Gravity(0.0, 0.15), None, True) == 0.15  # a direction by the motion is no surer than it
    assert direction_error(Gravity(0.2, 0.15), 0.0, True) == 0
    assert direction_error(None, 0.4, True) == 0.4
    assert direction_error(Gravity(0.0, 5.0), 0.4, True) == pytest.approx(0.4, rel=0.01)
    assert direction_error(Gravity(0.0, 0.01), 0.4, True) == pytest.approx(0.01, rel=0.01)
    assert direction_error(Gravity(0.3, 0.01), 0.4, False) == pytest.approx(0.3, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("role", others_slow(["joint", "tip"]))
def test_raw_angles_are_those_of_the_markers_and_the_corrected_ones_are_beside_them(tmp_path, role):
    table = markers(truth()[0, :2000])
    if role == "joint":  # on the first arm, 3 px beyond its hinge and 2 px aside
        along = np.stack([np.sin(truth()[0, :2000, 0]), np.cos(truth()[0, :2000, 0])], 1)
        table[["joint_x", "joint_y"]] += 3 * along + 2 * np.stack([along[:, 1], -along[:, 0]], 1)
    else:
        table[["tip_x", "tip_y"]] += [2.0, -3.0]
    angles, summary = measure(tmp_path, table)
    assert summary.offsets_px
    place = table[list(MARKERS)].to_numpy().reshape(-1, 3, 2)
    vector = np.diff(place, axis=1)
    alone = np.arctan2(vector[..., 0], vector[..., 1])
    off = np.angle(np.exp(1j * (angles[["theta1_raw", "theta2_raw"]].to_numpy() - alone)))
    known = angles["theta1_raw"].notna()
    assert known.mean() > 0.99 and np.abs(off[known]).max() < 1e-6
    true = np.angle(
        np.exp(1j * (angles[["theta1_unsmoothed", "theta2_unsmoothed"]].to_numpy() - truth()[0, :2000, :2]))
    )
    assert np.sqrt(np.mean(true[known] ** 2)) < 0.002 < np.sqrt(np.mean((alone - truth()[0, :2000, :2]) ** 2)) / 5
    # The page shows the lengths that are left.
    seen = np.linalg.norm(vector, axis=2)
    shown = correct_lengths(angles[["arm1_px", "arm2_px"]].to_numpy(), seen)
    assert (np.nanstd(shown, axis=0) < 0.2).all() and np.std(seen, axis=0).max() > 0.8
    plot_recording(*(tmp_path / name for name in ("markers.csv", "angles.csv", "angles.json")), tmp_path / "page.png")


def test_a_single_pendulum_s_page_has_its_own_lengths(tmp_path):
    y = np.repeat(truth()[0, :800, :1], 2, axis=1)
    angles, _ = measure(
        tmp_path, markers(np.concatenate((y, 0 * y), 1)).assign(tip_x=np.nan, tip_y=np.nan), single=True
    )
    assert angles["arm1_px"].notna().all() and angles["arm2_px"].isna().all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of means over nothing
        plot_recording(*(tmp_path / name for name in ("markers.csv", "angles.csv", "angles.json")), tmp_path / "p.png")


@pytest.mark.parametrize(("every", "wobble"), others_slow([(10, 0.5), (10, 0.25), (11, 0.3), (4, 0.3)]))
def test_lengths_that_vary_more_than_angles_err_do_not_enlarge_the_uncertainty(tmp_path, every, wobble):
    """A second arm that wobbles out of its plane, or whose marker is seen larger or smaller: along the arm alone."""
    y = truth()[1, : 700 * every : every]
    table = markers(y, 400 / every, noise=0.1)
    away = wobble * np.random.default_rng(1).normal(size=len(y))
    table["tip_x"] += away * np.sin(y[:, 1])
    table["tip_y"] += away * np.cos(y[:, 1])
    angles, _ = measure(tmp_path, table)
    good = angles["quality"] == 1

    def off(kind):
        error = angles[[f"theta1{kind}", f"theta2{kind}"]].to_numpy() - y[:, :2]
        return np.sqrt(np.mean(np.angle(np.exp(1j * error))[good] ** 2, axis=0))

    stated = np.sqrt(np.mean(angles[["theta1_std", "theta2_std"]].to_numpy()[good] ** 2, axis=0))
    ratio = stated / off("")
    assert ((ratio > 1 / 1.5) & (ratio < 1.5)).all(), ratio
    assert (off("") <= 1.02 * off("_unsmoothed")).all() and (off("") <= 1.02 * off("_raw")).all()
