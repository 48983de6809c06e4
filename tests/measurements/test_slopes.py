"""A column against the slope of another: what factor a rate's sensor has, and that sound columns raise no alarm."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from logger_tables import T, Y, csv
from swings import STEP, swing, table

import expertaug as ea
from expertaug import systems
from expertaug.cli import main
from expertaug.measurements.slopes import slope
from expertaug.systems import Parameter, System
from expertaug.systems.double_pendulum import DoublePendulum
from expertaug.systems.rlc import RLC
from nightly import others_slow

REAL = Path(__file__).parents[3] / "shared" / "measurements"
EXACT = np.stack([swing(0.3 + 0.2 * k) for k in range(6)])
NEEDS_REAL = pytest.mark.skipif(not REAL.is_dir(), reason="the measurements of another lab are not here")


def series(factor=1.0, noise=0.0, seed=0, offset=0.0, states=EXACT, step=STEP):
    """Times, angles and speeds of swings whose speeds a sensor shows by a factor."""
    rng = np.random.default_rng(seed)
    seen = states * [1.0, factor] + [0.0, offset] + noise * rng.standard_normal(states.shape)
    return [(step * np.arange(len(one)), one[:, 0], one[:, 1]) for one in seen]


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.05])
def test_a_sound_sensor_raises_no_alarm(noise):
    found = [slope(series(noise=noise, seed=seed)) for seed in range(20)]
    assert not any(one.is_off for one in found)
    assert abs(np.mean([one.factor for one in found]) - 1) < 0.002


def test_a_sensor_of_95_percent_is_told_with_an_error_as_large_as_the_errors():
    found = [slope(series(0.95, 0.05, seed, offset=0.3)) for seed in range(30)]
    assert all(one.is_off for one in found)
    scores = [(one.factor - 0.95) / one.error for one in found]
    assert 0.6 < np.std(scores) < 1.6 and abs(np.mean(scores)) < 0.6


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_an_offset_has_its_error(noise):
    found = [slope(series(1.0, noise, seed, offset=0.1)) for seed in range(20)]
    assert all(one.offset_is_off and not one.factor_is_off for one in found)
    assert np.mean([one.offset for one in found]) == pytest.approx(0.1, abs=0.005)


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("rows", [-7, 3, 10])
def test_a_rate_that_comes_late_is_told_by_how_much(rows, noise):
    states = np.stack([swing(0.3 + 0.2 * k, points=600) for k in range(3)])
    shifted = np.stack([np.stack((one[20:-20, 0], one[20 - rows : len(one) - 20 - rows, 1]), 1) for one in states])
    for seed in range(5):
        each = series(0.9, noise, seed, states=shifted)
        found = slope(each, delays=True)
        assert found.delay_s == pytest.approx(rows * STEP, abs=STEP) and found.factor == pytest.approx(0.9, abs=0.02)
        assert slope(each).delay_s == 0
        assert slope(series(0.9, noise, seed), delays=True).delay_s == 0


def test_an_even_rotation_has_a_factor():
    """Neither change nor duration alone tell an offset then."""
    t = 0.05 * np.arange(400)
    found = slope([(t, 1.9 * t, np.full(400, 1.9))])
    assert found.factor == pytest.approx(1) and not found.is_off
    assert slope([(t, 1.9 * t, np.full(400, 1.8))]).factor == pytest.approx(1.8 / 1.9)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_an_angle_without_its_sign_has_another_slope(noise):
    found = [slope([(t, np.abs(of), rate) for t, of, rate in series(noise=noise, seed=seed)]) for seed in range(10)]
    assert all(one.is_apart and not one.jumps for one in found)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_where_another_motion_begins_the_angle_jumps(noise):
    first, second = series(noise=noise)[:2]
    joined = [np.concatenate(both) for both in zip(first, second, strict=True)]
    joined[0] = STEP * np.arange(len(joined[0]))
    assert slope([tuple(joined)]).jumps == pytest.approx((STEP * len(first[0]),))
    glitch = [column.copy() for column in first]
    glitch[1][20] += 1.0
    assert not slope([tuple(glitch)]).jumps


def test_a_bounce_is_no_jump_of_the_height():
    t, g = 0.02 * np.arange(200), 9.81
    phase = (t + 0.37) % 0.8 - 0.4  # of a ball that falls and bounces without loss
    assert not slope([(t, 0.5 * g * (0.16 - phase**2), -g * phase)]).is_off


def test_noise_of_the_angle_does_not_flatten_the_slope():
    """Plain regression of the integral on the change would find about .95 of these, and alarm."""
    small = [(t, of, rate) for t, of, rate in series(states=EXACT[:1] * 0.5)]
    rng = np.random.default_rng(3)
    found = [slope([(t, of + 0.03 * rng.standard_normal(len(of)), rate) for t, of, rate in small]) for _ in range(20)]
    assert abs(np.mean([one.factor for one in found]) - 1) < 0.02 and not any(one.is_off for one in found)


@pytest.mark.parametrize("factor", [1.0, 0.95])
def test_rows_that_are_missing_or_wild(factor):
    rng, wild = np.random.default_rng(1), []
    for t, of, rate in series(factor, 0.01):
        kept = np.sort(rng.permutation(len(t))[: len(t) * 4 // 5])
        of, rate = of[kept].copy(), rate[kept].copy()
        of[rng.integers(len(of), size=4)] = np.nan
        rate[rng.integers(len(rate), size=4)] = np.nan
        of[rng.integers(len(of), size=2)] += 5.0
        wild.append((t[kept], of, rate))
    found = slope(wild)
    assert found.factor == pytest.approx(factor, abs=0.01) and found.is_off == (factor != 1)


def test_steps_too_coarse_to_integrate_over_are_no_alarm():
    coarse = [(t[::14], of[::14], rate[::14]) for t, of, rate in series(states=np.stack([swing(1.0, points=1500)]))]
    found = slope(coarse)
    assert found is None or not found.is_off


def test_too_few_rows_say_nothing():
    assert slope([(t[:12], of[:12], rate[:12]) for t, of, rate in series()[:1]]) is None
    assert slope([]) is None


def test_which_component_is_whose_rate_follows_from_the_system():
    class Cart(System):
        """A driven cart: of two positions and a speed one is the rate of the other."""

        state = (Parameter("v", "m/s"), Parameter("temperature", "K"), Parameter("x", "m"))
        expert_parameters = (Parameter("mass", "kg"),)
        inputs = (Parameter("force", "N"),)

        def expert(self, t, y, z_e, u):
            return torch.stack((u[..., 0] / z_e[..., 0], 0 * y[..., 0], y[..., 0]), dim=-1)

    class Broken(Cart):
        def expert(self, t, y, z_e, u):
            raise RuntimeError("not yet")

    assert systems.rates(Cart()) == {"v": "x"} and systems.rates(Broken()) == {}
    assert systems.rates(ea.DampedPendulum()) == {"omega": "theta"}
    assert systems.rates(RLC()) == {}
    double = DoublePendulum(expert="point_mass")
    assert systems.rates(double) == {"omega1": "theta1", "omega2": "theta2"}


def written(folder, factor=1.0, noise=0.01, wrapped=False, names=("angle", "speed")):
    """A table of swings, or of swings around the place at which an angle of a turn begins anew."""
    rows = []
    for k, (t, of, rate) in enumerate(series(factor, noise)):
        of = (of + 2 * np.pi) % (2 * np.pi) if wrapped else of
        rows.append(np.column_stack((np.full(len(t), k), t, of, rate)))
    return table(folder / "swings.csv", dict(zip(("trial", "t", *names), np.concatenate(rows).T, strict=True)))


READ = {"time": "t", "trajectory": "trial", "columns": {"theta": "angle", "omega": "speed"}, "length": 20}


@pytest.mark.parametrize("wrapped", [False, True])
@pytest.mark.parametrize("factor", [1.0, 0.95])
def test_every_way_in_says_it_before_anything_is_trained(tmp_path, capsys, factor, wrapped):
    path = written(tmp_path, factor, wrapped=wrapped)
    off = ["omega ('speed'): 0.9", "of the slope of theta ('angle'): a scale, or other units, of the sensor"]
    assert main(["inspect-data", str(path), "--system", "pendulum", "--output", str(tmp_path / "seen.png")]) == 0
    told = capsys.readouterr().out
    assert all(part in told for part in off) if factor != 1 else "of the slope of" not in told
    refinement = yaml.safe_load(told)["experiments"]["measured"]["refinement"]
    assert refinement.get("sensors") == (None if factor == 1 else {"omega": {"scale": "shared"}})
    angles = ["theta"] if wrapped else []
    ea.read_measurements(path, ea.DampedPendulum(), angles=angles, **READ)
    told = capsys.readouterr().err
    assert all(part in told for part in off) == (factor != 1)
    split = {"by": "time", "train_share": 0.5, "validation_share": 0.25, "test_share": 0.25}
    files = {**READ, "paths": str(path), "angles": angles, "stride": 4, "evaluation_stride": 10, "min_chunks": 1}
    job = {"files": files | {"split": split}, "system": {"name": "pendulum"}}
    data = ["cut-measurements", str(path), "--output", str(tmp_path / "data"), "--settings", json.dumps(job)]
    assert main(data) == 0
    told = capsys.readouterr().err
    assert all(part in told for part in off) == (factor != 1)


@pytest.mark.parametrize(
    ("names", "factor", "says"),
    others_slow(
        [
            (("angle", "speed"), 0.95, "speed: 0.9"),
            (("angle", "speed"), 1.0, None),
            (("phi [rad]", "gyro [rad/s]"), 0.95, "gyro [rad/s]"),
            (("a", "b"), 0.95, "b: if it is its rate, 0.9"),
            (("a", "b"), 0.5, None),
        ],
        2,
    ),
)
def test_without_a_system_names_units_or_a_close_fit_tell_a_rate(tmp_path, capsys, names, factor, says):
    path = written(tmp_path, factor, names=names)
    assert main(["inspect-data", str(path), "--output", str(tmp_path / "seen.png")]) == 0
    told = capsys.readouterr().out
    assert (says in told) if says else ("of the slope of" not in told)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda y: np.stack((y[:, 1], y[:, 0]), 1), "omega is no slope of theta, which is its slope: the two columns"),
        (lambda y: y * [1, -1], "of the slope of theta: one of the two has the other sign"),
        (
            lambda y: y + np.outer(T, [0.03, 0]),
            "beside the slope of theta: an offset of the sensor, or a drift of theta",
        ),
        (lambda y: np.stack((y[6:, 0], y[:-6, 1]), 1), "omega: about 0.3 s behind the slope of theta"),
        (lambda y: np.stack((np.abs(y[:, 0]), y[:, 1]), 1), "omega: far from the slope of theta: one of them has lost"),
        (lambda y: np.concatenate((y[:195], 0.5 * y[100:195])), "nothing in it of the jump of theta before 9.75 s"),
    ],
)
def test_what_is_off_is_told_by_its_kind(inspected, change, says):
    y = change(Y)
    told, _ = inspected(csv(y[:, 0], y[:, 1], T[: len(y)]))
    assert says in told and "sensors:" not in told


@NEEDS_REAL
def test_the_real_pendulums_speed_is_off_by_five_percent(tmp_path, capsys):
    names = ["--set", "names=[trial, time, angle, speed]", "--output", str(tmp_path / "seen.png")]
    path = str(REAL / "real_pend_h_1.txt")
    assert main(["inspect-data", path, "--system", "pendulum", *names]) == 0
    assert "omega ('speed'): 0.954 (± 0.0006) of the slope of theta ('angle')" in capsys.readouterr().out
    rows = np.loadtxt(path, comments="%")
    for quarter in np.array_split(rows, 4):
        found = slope([(quarter[:, 1], quarter[:, 2], quarter[:, 3])])
        assert found is None or found.factor == pytest.approx(0.953, abs=0.006)


@pytest.mark.slow
@NEEDS_REAL
def test_the_other_labs_double_pendulum_raises_no_alarm(tmp_path, capsys):
    names = "names=[trial, time, theta1, theta2, omega1, omega2, w1, w2, a1, a2]"
    path = str(REAL / "real_double_pend_h_1.txt")
    system = '{"name": "double_pendulum", "expert": "point_mass"}'
    for more in (["--system", system], []):
        assert main(["inspect-data", path, "--set", names, *more, "--output", str(tmp_path / "seen.png")]) == 0
        assert "of the slope of" not in capsys.readouterr().out
