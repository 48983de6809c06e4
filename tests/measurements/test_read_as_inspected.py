"""What would be read as something else in silence: refused or named, by inspect-data and by the reader alike."""

from __future__ import annotations

import math

import numpy as np
import pytest
import yaml

import expertaug as ea
from expertaug.cli import main
from expertaug.errors import InputError
from expertaug.measurements.sensors import jumps_by_turns
from expertaug.measurements.units import parse

T = np.arange(400) * 0.05
DEG = 180 / math.pi
RNG = np.random.default_rng(0)
THETA = np.cos(2 * T) + 2e-3 * RNG.standard_normal(400)
OMEGA = -2 * np.sin(2 * T) + 4e-3 * RNG.standard_normal(400)


def table(path, header, *columns):
    rows = [
        ",".join(one if isinstance(one, str) else f"{one:.10g}" for one in row) for row in zip(*columns, strict=True)
    ]
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def look(tmp_path, capsys):
    """What inspect-data says: the error's line, or what it prints and the proposed ``data.files``."""

    def inspected(header, *columns, options=(), status=0, more=()):
        files = [table(tmp_path / "a.csv", header, *columns), *more]
        line = ["inspect-data", *map(str, files), "--system", "pendulum", "--output", str(tmp_path / "x.png"), *options]
        assert main(line) == status, capsys.readouterr()
        said = capsys.readouterr()
        if status:
            assert len(said.err.strip().splitlines()) == 1
            return said.err
        return said.out, yaml.safe_load(said.out)["experiments"]["measured"]["data"]

    return inspected


def read(path, columns=None, **settings):
    given = {"columns": columns or {"theta": "theta", "omega": "omega"}, "length": 20} | settings
    return ea.read_measurements(path, ea.DampedPendulum(), **given)


# Units


@pytest.mark.parametrize("unit", ["Grad", "Mrad", "krad", "Gdeg", "Winkelgrad"])
def test_no_unit_is_a_thousand_or_more_of_an_angle(unit, look):
    assert parse(unit) is None
    error = look(f"t,theta [{unit}],omega [{unit}/s]", T, DEG * THETA, DEG * OMEGA, status=2)
    assert f"the unit '{unit}' is not understood" in error


@pytest.mark.parametrize(
    "headers", [("deg_theta", "deg_s_omega"), ("THETA_DEG", "OMEGA_DEG_PER_S"), ("phi_deg", "phi_dot_dps")]
)
def test_units_in_front_are_converted(headers, look):
    _, data = look(f"t,{headers[0]},{headers[1]}", T, DEG * THETA, DEG * OMEGA)
    columns = data["files"]["columns"]
    assert {columns[name]["name"] for name in ("theta", "omega")} == set(headers)
    assert parse(columns["omega"]["unit"]).factor == pytest.approx(1 / DEG)


def test_a_speed_in_degrees_alone_is_no_speed(look):
    assert "'degree' is a unit of angle" in look("t,phi_degree,phi_dot_degree", T, DEG * THETA, DEG * OMEGA, status=2)


def test_a_pair_of_which_one_unit_is_told_is_refused_by_the_reader(tmp_path):
    path = table(tmp_path / "a.csv", "t,theta_deg,omega", T, DEG * THETA, DEG * OMEGA)
    columns = {"theta": {"name": "theta_deg", "unit": "deg"}, "omega": "omega"}
    with pytest.raises(InputError, match=r"'omega' has no unit; say which: set data\.files\.columns\.omega\.unit"):
        read(path, columns)
    columns["omega"] = {"name": "omega", "unit": "deg/s"}
    assert np.abs(read(path, columns).y[..., 1]).max() == pytest.approx(2, abs=0.05)


def test_files_whose_rows_of_units_differ_are_refused(tmp_path):
    def with_units(name, units, factor):
        columns = (
            [unit, *map(repr, y.tolist())] for unit, y in zip(units, (T, factor * THETA, factor * OMEGA), strict=True)
        )
        return table(tmp_path / name, "t,theta,omega", *columns)

    deg, rad = with_units("b.csv", ("s", "deg", "deg/s"), DEG), with_units("c.csv", ("s", "rad", "rad/s"), 1)
    columns = {"theta": {"name": "theta", "unit": "deg"}, "omega": {"name": "omega", "unit": "deg/s"}}
    with pytest.raises(InputError, match=r"c\.csv: column 'theta' is in rad, and in deg in b\.csv"):
        read([deg, rad], columns)
    assert main(["inspect-data", str(deg), str(rad), "--system", "pendulum", "--output", str(tmp_path / "x.png")]) == 2


# Marks of nothing measured


@pytest.mark.parametrize("mark", [-999.0, -200.0, -1000.0, 4095.0, 1e10, -99.0])
def test_a_value_far_from_all_others_that_comes_again_is_a_mark(mark, look, tmp_path):
    theta = THETA.copy()
    theta[40:400:37] = mark
    said, data = look("t,theta,omega", T, theta, OMEGA)
    assert data["files"]["missing"] == [mark] and f"{mark:.10g} (in 'theta')" in said
    with pytest.raises(
        InputError, match=rf"row 42, column theta: {mark:.10g} is far from all others".replace("+", r"\+")
    ):
        read(tmp_path / "a.csv")
    assert np.abs(read(tmp_path / "a.csv", missing=[mark]).y[..., 0]).max() < 1.1
    assert np.abs(read(tmp_path / "a.csv", missing=[]).y[..., 0]).max() == abs(np.float32(mark))


def test_marks_of_any_of_the_files_are_found(tmp_path, look):
    theta = THETA.copy()
    theta[5::50] = -999
    other = table(tmp_path / "b.csv", "t,theta,omega", T, theta, OMEGA)
    said, data = look("t,theta,omega", T, THETA, OMEGA, more=[other])
    assert data["files"]["missing"] == [-999] and said.count("taken for marks") == 1


def test_a_huge_mark_is_proposed_as_it_can_be_read(tmp_path, look):
    theta = THETA.copy()
    theta[5::50] = 1e99
    said, data = look("t,theta,omega", T, theta, OMEGA)
    assert data["files"]["missing"] == [1e99] and "1.0e+99" in said.partition("missing: ")[2]


# Angles


def test_one_file_of_a_wrapped_angle_is_enough(tmp_path, look):
    turning = 3.0 * T
    wrapped = table(tmp_path / "b.csv", "t,theta,omega", T, (turning + np.pi) % (2 * np.pi) - np.pi, 3 + 0 * T)
    _, data = look("t,theta,omega", T, turning, 3 + 0 * T, more=[wrapped])
    assert data["files"]["angles"] == ["theta"]


def test_a_direction_without_ends_is_named(look):
    said, _ = look("t,theta,omega", T, (3 * T + np.pi / 2) % np.pi - np.pi / 2, 3 + 0 * T)
    assert "jumps from end to end, as the direction of a rod does" in said
    assert not jumps_by_turns([THETA], math.pi)


# Times


@pytest.mark.parametrize(
    ("name", "times", "found"),
    [
        ("time", 45000.25 + np.arange(400) / 24, "as a spreadsheet's days do"),
        ("time", 739000.25 + np.arange(400) * 2 / 86400, "as MATLAB's days do"),
        ("time", 2460000.5 + np.arange(400) * 2 / 86400, "as Julian days do"),
        ("time", 0.25 + np.arange(400) / 86400, "1 s of a day"),
        ("date", 45000.0 + np.arange(400), "as a spreadsheet's days do"),
        ("time", [10000 * (k // 3600) + 100 * (k // 60 % 60) + k % 60 for k in range(36000, 36400)], "(hhmmss)"),
        ("time", [20240531100000 + 100 * (k // 60) + k % 60 for k in range(400)], "(yyyymmddhhmmss)"),
        ("frame", np.arange(400), "counts rows"),
        ("index", np.arange(400), "counts rows"),
        ("time", 1.7e12 + 50 * np.arange(400), "ms since 1970"),
    ],
)
def test_numbers_that_are_no_seconds_are_named_by_both(name, times, found, look, tmp_path):
    times = [f"{value:.15g}" for value in times]
    options = ["--time", name]
    error = look(f"{name},theta,omega", times, THETA, OMEGA, options=options, status=2)
    assert found in error
    with pytest.raises(InputError) as reader:
        read(tmp_path / "a.csv", time=name)
    assert found in str(reader.value)


@pytest.mark.parametrize(
    ("name", "times"),
    [("t", T), ("t", 45000 + T), ("t", 0.01 * np.arange(400)), ("time", np.arange(400.0)), ("t", np.arange(400) / 30)],
    ids=["t", "of day", "hundredths", "seconds", "thirtieths"],
)
def test_seconds_are_seconds(name, times, look, tmp_path):
    look(f"{name},theta,omega", [f"{value:.12g}" for value in times], THETA, OMEGA)
    assert len(read(tmp_path / "a.csv", time=name)) > 10


def test_a_step_of_a_counter_may_be_told(tmp_path):
    table(tmp_path / "a.csv", "frame,theta,omega", np.arange(400), THETA, OMEGA)
    assert read(tmp_path / "a.csv", time={"name": "frame", "factor": 0.05}).t[1] == pytest.approx(0.05)


def test_a_counter_of_rows_tells_no_trajectories(look):
    said, data = look("sample,time,theta,omega", np.arange(400), T, THETA, OMEGA)
    assert data["files"]["time"] == "time" and "trajectory" not in data["files"] and "one per file" in said


def test_seconds_beside_microseconds_are_no_trajectory(look):
    sec, usec = np.floor(T), np.round(1e6 * (T % 1))
    assert "are parts of the time" in look("tv_sec,tv_usec,theta,omega", 1.7e9 + sec, usec, THETA, OMEGA, status=2)


# Rows that do not belong together


def test_rows_of_a_second_are_not_averaged(look):
    clock = [f"2024-05-31 10:{k // 60:02d}:{k % 60:02d}" for k in np.arange(400) // 20]
    assert "20 rows have the same time in the mean" in look("time,theta,omega", clock, THETA, OMEGA, status=2)


def test_two_runs_row_by_row_are_not_averaged(look):
    pairs = [np.stack((one, 0.3 * one), 1).ravel() for one in (THETA, OMEGA)]
    assert "2 rows have the same time" in look("t,theta,omega", np.repeat(T, 2), *pairs, status=2)


@pytest.mark.parametrize("back", [0.2, 0.19])
def test_a_clock_that_was_set_back_a_little_is_no_disorder(back, look, tmp_path):
    times = np.where(np.arange(400) < 200, T, T - back)
    assert "row 202: the time goes back" in look("t,theta,omega", times, THETA, OMEGA, status=2)
    with pytest.raises(InputError, match="row 202: the time goes back"):
        read(tmp_path / "a.csv", unordered="sort", duplicates="mean")


def test_runs_that_follow_each_other_are_not_sorted_by_the_reader(tmp_path):
    twice = (np.r_[T, T + 0.01], np.r_[THETA, 0.5 * THETA], np.r_[OMEGA, 0.5 * OMEGA])
    path = table(tmp_path / "a.csv", "t,theta,omega", *twice)
    with pytest.raises(InputError, match="as if 2 trajectories followed each other"):
        read(path, unordered="sort")


def test_halves_in_the_wrong_order_are_put_in_order(tmp_path):
    order = np.r_[200:400, 0:200]
    path = table(tmp_path / "a.csv", "t,theta,omega", T[order], THETA[order], OMEGA[order])
    assert read(path, unordered="sort").y[0, 0, 0] == pytest.approx(THETA[0])


# Columns


@pytest.mark.parametrize("other", ["theta_ref", "theta_std", "theta_B", "theta2", "omega_ref", "setpoint"])
def test_a_column_beside_the_measured_one_is_not_its_speed(other, look):
    _, data = look(f"t,theta,{other}", T, THETA, OMEGA)
    assert data["files"]["columns"] == {"theta": "theta"}


@pytest.mark.parametrize(
    ("headers", "columns"),
    [
        (("omega_raw", "theta_raw"), {"theta": "theta_raw", "omega": "omega_raw"}),
        (("pendulum angle", "angular speed"), {"theta": "pendulum angle", "omega": "angular speed"}),
        (("thteta", "omegga"), {"theta": "thteta", "omega": "omegga"}),
        (("phi", "phi_dot"), {"theta": "phi", "omega": "phi_dot"}),
    ],
)
def test_columns_are_found_by_a_word_of_their_name(headers, columns, look):
    data = look(f"t,{','.join(headers)}", T, *((OMEGA, THETA) if "omega" in headers[0] else (THETA, OMEGA)))[1]
    assert data["files"]["columns"] == columns


def test_a_long_table_whose_sensors_have_times_of_their_own_is_pivoted(look):
    times, names = np.stack((T, T + 0.013), 1).ravel(), ["theta", "omega"] * 400
    _, data = look("t,channel,reading", times, names, np.stack((THETA, OMEGA), 1).ravel())
    assert data["files"]["pivot"] == {"name": "channel", "value": "reading"}
    assert data["files"]["columns"] == {"theta": "theta", "omega": "omega"}


@pytest.mark.parametrize("mark", ["'", " "])
def test_thousands_may_stand_apart(mark, look):
    counts = [f"{value:,.0f}".replace(",", mark) for value in 1e4 * (2 + THETA)]
    _, data = look("t,theta,omega", T, counts, OMEGA)
    assert data["files"]["thousands"] == mark and "theta" in data["files"]["columns"]


# Sensors


def test_estimated_noise_is_at_least_that_of_the_steps(tmp_path):
    q = 0.2
    path = table(tmp_path / "a.csv", "t,theta,omega", T, q * np.round(np.cos(0.2 * T) / q), OMEGA)
    assert read(path).noise[0] == pytest.approx(q / math.sqrt(12), rel=1e-3)


def test_a_speed_of_the_other_sign_is_said_without_a_warning_of_numpy(look, recwarn):
    wrapped = np.degrees(THETA) % 360
    wrapped[100] = 999
    look("t,theta [deg],omega [deg/s]", T, wrapped, -np.degrees(OMEGA))
    assert not [one for one in recwarn if issubclass(one.category, RuntimeWarning)]
