"""Units as people write them in headers: understood by one parser, or named and refused; never taken for another."""

from __future__ import annotations

import math

import numpy as np
import pytest
import yaml
from swings import NAMES, STEP, settings, swing, table

from expertaug.cli import main
from expertaug.errors import InputError
from expertaug.measurements.cut import measure
from expertaug.measurements.settings import Column
from expertaug.measurements.units import conversion, parse, parse_header
from nightly import others_slow

DEG = math.pi / 180
ANGLES = {
    "theta_deg": DEG,
    "theta [DEG]": DEG,
    "theta (degrees)": DEG,
    "theta / deg": DEG,
    "theta in deg": DEG,
    "theta, deg": DEG,
    "theta (°)": DEG,
    "theta°": DEG,
    "thetaDeg": DEG,
    "theta.deg": DEG,
    "theta{Grad°}": DEG,
    "theta_mrad": 1e-3,
    "theta [gon]": math.pi / 200,
    "theta (turns)": 2 * math.pi,
    "theta_rad": 1.0,
}
SPEEDS = {
    "omega_deg_s": DEG,
    "omega_deg_per_s": DEG,
    "omega_dps": DEG,
    "omega degps": DEG,
    "omega [deg/s]": DEG,
    "omega (DEG/S)": DEG,
    "omega / (deg/s)": DEG,
    "omega / deg/s": DEG,
    "omega in °/s": DEG,
    "omega (degrees per second)": DEG,
    "omega (deg s^-1)": DEG,
    "omega [deg·s⁻¹]": DEG,
    "omegaDegPerSec": DEG,
    "omega_mrad_s": 1e-3,
    "omega (rpm)": math.pi / 30,
    "omega [U/min]": math.pi / 30,
    "omega_rad/s": 1.0,
}


@pytest.mark.parametrize(("header", "factor"), [*ANGLES.items(), *SPEEDS.items()])
def test_a_header_tells_name_and_unit(header, factor):
    found = parse_header(header)
    assert found.name in ("theta", "omega")
    to = "rad" if found.name == "theta" else "rad/s"
    assert conversion(found.unit, to, "") == (pytest.approx(factor), 0.0)


@pytest.mark.parametrize(
    ("text", "to", "factor"),
    [
        ("µs", "s", 1e-6),
        ("MS", "s", 1e-3),
        ("min", "s", 60),
        ("weeks", "s", 604800),
        ("Millimeter", "m", 1e-3),
        ("m s^-2", "m/s2", 1),
        ("m/s²", "m/s2", 1),
        ("m_s2", "m/s2", 1),
        ("kHz", "1/s", 1e3),
        ("mV", "V", 1e-3),
        ("kΩ", "ohm", 1e3),
        ("N·m", "Nm", 1),
        ("kg m^2 / s^2", "J", 1),
        ("J/(kg K)", "J/kg/K", 1),
        ("1/(m s)", "m-1 s-1", 1),
    ],
)
def test_products_powers_and_prefixes(text, to, factor):
    assert conversion(text, to, "") == (pytest.approx(factor), 0.0)


@pytest.mark.parametrize("header", ["dtheta/dt", "theta_left", "omega raw", "spring_v", "x position", "max", "t"])
def test_names_are_no_units(header):
    assert parse_header(header).unit == ""


@pytest.mark.parametrize("text", ["ticks", "deg//s", "deg^", "(deg", "m" * 50, "s^999", "/", "*", "__", "deg (", "°°"])
def test_what_is_no_unit_is_none(text):
    assert parse(text) is None


def lab(folder, time, angle, speed, y=None):
    y = swing(1.0)[:120] if y is None else y
    return table(folder / "lab.csv", {time: STEP * np.arange(len(y)), angle: y[:, 0], speed: y[:, 1]}, "\t")


def inspected(path, capsys, *more):
    status = main(["inspect-data", str(path), "--system", "pendulum", "--output", f"{path}.png", *more])
    said = capsys.readouterr()
    return status, said.out, said.err


@pytest.mark.parametrize(("angle", "speed"), others_slow(zip(list(ANGLES)[:14], list(SPEEDS)[:14], strict=True), 7))
def test_inspected_and_read_alike(tmp_path, capsys, angle, speed):
    y = swing(1.0)[:120]
    path = lab(tmp_path, "t (s)", angle, speed, y / [ANGLES[angle], SPEEDS[speed]])
    status, out, err = inspected(path, capsys)
    assert status == 0, err
    files = yaml.safe_load(out)["experiments"]["measured"]["data"]["files"]
    files |= {"length": 20, "min_chunks": 1}
    assert "no unit is given" not in out
    found = measure(settings(path, **{"trajectory": None} | files), NAMES).grid.series[0].y
    assert np.allclose(found, y, atol=1e-6)


@pytest.mark.parametrize(
    ("headers", "message"),
    [
        (("t", "theta [mm]", "omega"), "column 'theta [mm]': 'mm' is a unit of length, rad is expected"),
        (("t", "theta (rad)", "omega (V)"), "'V' is a unit of voltage"),
        (("t", "theta_rad_s", "omega"), "'rad_s' is a unit of angular speed"),
        (("t [ticks]", "theta", "omega"), "column 't [ticks]': the unit 'ticks' is not understood"),
        (("t (frames)", "theta", "omega"), "the unit 'frames' is not understood"),
        (("t", "theta [foo]", "omega"), "the unit 'foo' is not understood"),
        (("t", "theta_deg", "omega"), "'theta_deg' is in deg, and 'omega' has no unit"),
        (("t", "theta", "omega (rpm)"), "'omega (rpm)' is in rpm, and 'theta' has no unit"),
    ],
)
def test_another_kind_or_half_a_pair_is_named_and_refused(tmp_path, capsys, headers, message):
    status, out, err = inspected(lab(tmp_path, *headers), capsys)
    assert status == 2 and not out and err.count("\n") == 1
    assert message in err and "--unit" in err, err


def test_a_unit_can_be_said(tmp_path, capsys):
    path = lab(tmp_path, "t [ticks]", "theta_deg", "omega")
    status, out, err = inspected(path, capsys, "--unit", "t [ticks]=ms", "--unit", "omega=deg/s")
    assert status == 0, err
    files = yaml.safe_load(out)["experiments"]["measured"]["data"]["files"]
    assert files["time"] == {"name": "t [ticks]", "unit": "ms"}
    assert files["columns"]["omega"] == {"name": "omega", "unit": "deg/s"}
    status, out, err = inspected(path, capsys, "--unit", "speed=ms")
    assert status == 2 and "--unit: no column 'speed'" in err


@pytest.mark.parametrize("option", ["--time", "--trajectory"])
def test_a_misspelt_column_is_refused_in_one_line(option, tmp_path, capsys):
    path = tmp_path / "t.csv"
    path.write_text("time,theta\n" + "".join(f"{k},{k % 3}\n" for k in range(30)))
    status, _, err = inspected(path, capsys, option, "tme")
    assert status == 2 and err == f"expertaug inspect-data: {option}: no column 'tme'; its columns are time, theta\n"


def test_a_column_that_is_not_read_is_named(tmp_path, capsys):
    path = lab(tmp_path, "t", "theta", "omega")
    lines = path.read_text().splitlines()
    path.write_text("\n".join([f"{lines[0]}\tstate", *(f"{line}\tok" for line in lines[1:])]))
    status, out, _ = inspected(path, capsys)
    assert status == 0 and "not read, as most of their cells are no numbers: state" in out


@pytest.mark.parametrize(
    ("headers", "message"),
    [
        (("t", "theta (deg)", "omega"), r"columns\.theta\.unit: missing: column 'theta \(deg\)' tells deg"),
        (("t", "theta", "omega_dps"), r"columns\.omega\.unit: missing: column 'omega_dps' tells dps"),
        (("t", "theta [V]", "omega"), r"tells V, a unit of voltage, the system has rad"),
        (("Time (ms)", "theta", "omega"), r"time\.unit: missing: column 'Time \(ms\)' tells ms"),
        (("t [ticks]", "theta", "omega"), r"time\.unit: the unit 'ticks' of column 't \[ticks\]' is not understood"),
    ],
)
def test_a_reader_without_a_unit_does_not_take_another_for_its_own(tmp_path, headers, message):
    path = lab(tmp_path, *headers)
    given = {"trajectory": None, "time": headers[0], "columns": dict(zip(("theta", "omega"), headers[1:], strict=True))}
    with pytest.raises(InputError, match=message):
        measure(settings(path, **given), NAMES)
    # a factor of one's own is a word too
    given["time"] = Column(name=headers[0], factor=0.5)
    given["columns"] = {name: Column(name=column, factor=0.5) for name, column in given["columns"].items()}
    measure(settings(path, **given), NAMES)


@pytest.mark.parametrize(
    ("header", "factor"),
    [
        ("timeMs", 1e-3),
        ("timeUs", 1e-6),
        ("millis", 1e-3),
        ("timestamp_us", 1e-6),
        ("mdps", 2 * math.pi / 360e3),
        ("gyro_mdps", 2 * math.pi / 360e3),
        ("theta [deg] (raw)", 2 * math.pi / 360),
        ("thetaDeg", 2 * math.pi / 360),
    ],
)
def test_spellings_of_loggers(header, factor):
    unit = parse(parse_header(header).unit)
    assert unit is not None and unit.factor == pytest.approx(factor)


@pytest.mark.parametrize("header", ["t (Ms)", "time [Ms]", "theta in grad", "omega in grad/s", "time in ticks"])
def test_what_may_be_a_unit_and_is_none_is_not_passed_over(header):
    """10⁶ s are nobody's, and Grad is a degree to some and a gon to others: they are refused, not taken as SI."""
    found = parse_header(header)
    assert found.unit and found.sure and parse(found.unit) is None


KINDS = (
    "rad mrad deg gon rev",
    "rad/s deg/s rpm rev/s dps",
    "s ms us ns min h d week",
    "1/s 1/min 1/h 1/d Hz kHz",
    "m km cm mm um in ft",
    "m/s cm/s mm/s km/h",
    "m/s2 mm/s2 g0",
    "V kV mV uV",
    "A mA uA",
    "ohm kohm Mohm",
    "F mF uF nF pF",
    "H mH uH",
    "kg g mg",
    "N kN mN",
    "Pa kPa hPa bar mbar",
    "K degC degF",
    "1 % 1000",
)


def test_units_go_both_ways():
    for units in map(str.split, KINDS):
        for one in units:
            for other in units:
                (a, b), (c, d) = conversion(one, other, ""), conversion(other, one, "")
                assert (3.7 * a + b) * c + d == pytest.approx(3.7, abs=1e-9)
    assert conversion("°C", "K", "") == (1.0, 273.15)
    assert conversion("rpm", "rad/s", "")[0] == pytest.approx(2 * np.pi / 60)
    assert conversion(None, "anything", "") == conversion("same", "same", "") == (1.0, 0.0)


@pytest.mark.parametrize(
    ("unit", "to", "message"),
    [("mm", "rad", "a unit of length, the system has rad"), ("furlong", "m", "not known; units of length: m, km")],
)
def test_units_that_do_not_fit_are_refused(unit, to, message):
    with pytest.raises(InputError, match=message):
        conversion(unit, to, "data.files.columns.x.unit")


def test_small_parts_of_a_radian_are_units():
    assert parse("mrad").factor == pytest.approx(1e-3) and parse("urad").factor == pytest.approx(1e-6)
    assert parse("kohm").factor == 1e3 and parse("MHz").factor == 1e6


@pytest.mark.parametrize(
    ("header", "name"),
    [("deg_theta", "theta"), ("deg_s_omega", "omega"), ("rpm_motor", "motor"), ("OMEGA_DEG_PER_S", "OMEGA")],
)
def test_a_unit_may_stand_in_front_and_in_capitals(header, name):
    found = parse_header(header)
    assert found.name == name and parse(found.unit) is not None


def test_words_in_front_are_no_units():
    assert parse_header("min_theta").unit == parse_header("in_x").unit == parse_header("h_theta").unit == ""
