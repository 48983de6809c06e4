"""What inspect-data says of sensors and loggers, and the configuration that it proposes for them."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from swings import NAMES, swing

from expertaug.cli import main
from expertaug.errors import InputError
from expertaug.measurements.cut import all_chunks, measure
from expertaug.measurements.settings import MeasurementSettings, Pivot, TableKeys
from expertaug.measurements.table import read_table
from nightly import others_slow

T = 0.05 * np.arange(400)
Y = swing(1.0, points=400) + 0.005 * np.random.default_rng(0).standard_normal((400, 2))


@pytest.fixture
def inspected(tmp_path, capsys):
    """What is said of a text file, and the block ``data`` that is proposed."""

    def look(text: str, *options: str, status: int = 0, system: str = "pendulum"):
        path = tmp_path / "a.csv"
        path.write_text(text)
        picture = ["--output", str(tmp_path / "x.png")]
        assert main(["inspect-data", str(path), "--system", system, *picture, *options]) == status
        told = capsys.readouterr()
        if status:
            return told.err, None
        return told.out, yaml.safe_load(told.out)["experiments"]["measured"]["data"]

    return look


def csv(theta=Y[:, 0], omega=Y[:, 1], t=T, header="t,theta,omega", form="{:.5f}"):
    cells = [
        [one if isinstance(one, str) else form.format(one) for one in row] for row in zip(t, theta, omega, strict=True)
    ]
    return "\n".join([header, *map(",".join, cells)]) + "\n"


def rows_of(data):
    return measure(MeasurementSettings.from_mapping(data["files"]), NAMES).grid.series[0].rows


def test_a_quantised_sensor_has_the_noise_of_its_steps_and_chunks_span_its_swings(inspected):
    t = np.arange(12000) / 2000
    step = 0.01
    theta = step * np.round(np.cos(2 * np.pi * t) / step)
    told, data = inspected(
        csv(theta, -6.28 * np.sin(2 * np.pi * t) + 0.01 * np.random.default_rng(0).normal(size=12000), t)
    )
    assert "from steps of 0.01" in told
    assert data["noise"]["theta"] == pytest.approx(step / 12**0.5, rel=0.01) and data["noise"]["omega"] > 0.005
    assert data["files"]["step_s"] == pytest.approx(1 / 40)
    assert data["files"]["length"] * data["files"]["step_s"] > 0.5
    assert measure(MeasurementSettings.from_mapping(data["files"]), NAMES).grid.step == 50


def test_noise_that_is_larger_than_a_steps_is_estimated(inspected):
    told, data = inspected(csv(form="{:.3f}"))
    assert data["noise"] == "estimated" and "step /" not in told and "step_s" not in data["files"]


@pytest.mark.parametrize(("unit", "turn", "low"), [("rad", 2 * np.pi, -np.pi), ("deg", 360, 0)])
def test_wrapped_angles_are_proposed_as_such(inspected, unit, turn, low):
    angle = turn / (2 * np.pi) * (0.3 + 1.9 * T + 0.5 * np.sin(T))
    rate = turn / (2 * np.pi) * (1.9 + 0.5 * np.cos(T))
    wrapped = low + (angle - low) % turn
    told, data = inspected(csv(wrapped, rate, header=f"t,theta ({unit}),omega ({unit}/s)"))
    assert data["files"]["angles"] == ["theta"] and "unwrapped" in told
    assert (
        np.abs(np.diff(measure(MeasurementSettings.from_mapping(data["files"]), NAMES).grid.series[0].y[:, 0])).max()
        < 0.2
    )
    assert "angles" not in inspected(csv())[1]["files"]


@pytest.mark.parametrize("mark", others_slow(["-999", "9999", "-9999.0", "99999", "1e30", "-9.96921e36"], 3))
def test_marks_of_nothing_measured_are_named_and_left_out(inspected, mark):
    theta = [mark if k % 9 == 0 else f"{v:.5f}" for k, v in enumerate(Y[:, 0])]
    told, data = inspected(csv(theta))
    assert data["files"]["missing"] == [float(mark)] and "--set missing=[]" in told
    assert np.isnan(rows_of(data).y[:, 0]).sum() == 45
    assert "missing" not in inspected(csv(form="{:.2f}"))[1]["files"]


def test_numbers_of_nines_that_others_are_near_are_numbers(inspected):
    assert "missing" not in inspected(csv(1000 * Y[:, 0], 999 * Y[:, 1] / Y[:, 1].max()))[1]["files"]


def test_texts_may_be_marks(tmp_path, inspected):
    theta = ["OVR" if k % 9 == 0 else f"{v:.5f}" for k, v in enumerate(Y[:, 0])]
    told, _ = inspected(csv(theta), status=2)
    assert "row 2, column theta: 'OVR' is no number" in told and "missing" in told
    _, data = inspected(csv(theta), "--set", "missing=[OVR]")
    assert data["files"]["missing"] == ["OVR"] and np.isnan(rows_of(data).y[:, 0]).sum() == 45


@pytest.mark.parametrize(
    ("numbers", "keys"),
    [
        (
            lambda v: f"{v:,.1f}".replace(",", " ").replace(".", ",").replace(" ", "."),
            {"thousands": ".", "decimal": ","},
        ),
        (lambda v: f"{v:,.1f}", {"thousands": ","}),
        (lambda v: f"{v:,.0f}".replace(",", "."), {"thousands": ".", "decimal": ","}),
        (lambda v: f"{v:,.2f}".replace(",", "'"), {"thousands": "'"}),
    ],
    ids=["1.234,5", "1,234.5", "1.234", "1'234.50"],
)
def test_thousands_are_recognised(inspected, numbers, keys):
    lines = ["t;theta;omega", *(f"{k};{numbers(3000 * a)};{numbers(3000 * b)}" for k, (a, b) in enumerate(Y))]
    told, data = inspected("\n".join(lines) + "\n")
    found = {key: data["files"].get(key, ".") for key in ("thousands", "decimal")}
    assert found == {"decimal": "."} | keys and "separates thousands" in told
    np.testing.assert_allclose(rows_of(data).y, 3000 * Y, atol=0.51)


def test_fractions_of_three_digits_are_fractions(inspected):
    for form in ("{:.3f}", "{:.4g}"):
        assert "thousands" not in inspected(csv(form=form))[1]["files"]


def test_saturation_is_said(inspected):
    told, _ = inspected(csv(np.minimum(Y[:, 0], 0.6)))
    assert "'theta' stays at 0.6, an end of its range, for up to" in told
    assert "saturated" not in inspected(csv())[0] + inspected(csv(form="{:.2f}"))[0]


PREAMBLES = {
    "words": "Device: logger 7\nSerial 1234\nStart: 2021-03-28 10:00\n\n",
    "pairs": "Writer,2\nSeparator,Comma\nDate,2021/03/28\n***End***\n\nChannels,2,\nSamples,400,400,\n",
    "one word": "Measurement\n",
}


@pytest.mark.parametrize("above", PREAMBLES)
@pytest.mark.parametrize("units", ["", "s,rad,rad/s\n"])
def test_lines_of_a_logger_above_the_table_are_skipped(inspected, above, units, tmp_path):
    header, _, rows = csv().partition("\n")
    text = f"{PREAMBLES[above]}{header}\n{units}{rows}"
    told, data = inspected(text)
    assert data["files"]["skip_lines"] == PREAMBLES[above].count("\n") and "lines above the table" in told
    np.testing.assert_allclose(rows_of(data).y, Y, atol=1e-5)
    if above != "one word":
        with pytest.raises(InputError, match=f"skip_lines to {PREAMBLES[above].count(chr(10))}"):
            read_table(tmp_path / "a.csv", TableKeys())


def test_what_a_spreadsheet_leaves_at_the_right_and_below_is_nothing(inspected):
    text = "\n".join(f"{line},,," for line in csv().splitlines()) + "\n,,,,,\n,,,,,\n"
    told, data = inspected(text)
    assert "400 rows" in told and "not read" not in told and list(data["files"]["columns"]) == ["theta", "omega"]


def test_rows_off_the_grid_are_said_everywhere(inspected, tmp_path):
    jitter = T + 0.02 * (np.arange(400) % 10 == 7)
    told, data = inspected(csv(t=jitter))
    assert "% of the rows lie off the grid of" in told and data["files"]["uneven"] == "own"
    given = data["files"] | {"uneven": "mask", "step_s": None, "length": 50, "stride": 5, "evaluation_stride": 50}
    with pytest.raises(InputError, match=r"% of the rows lie off the grid of .* set uneven to own"):
        all_chunks(measure(MeasurementSettings.from_mapping(given), NAMES))


def test_times_in_few_digits_keep_them(inspected):
    told, data = inspected(csv(t=[f"{k / 300:.3f}" for k in range(400)]))
    assert "rows lie on 30 % of the points" in told
    assert data["files"]["uneven"] == "own" and data["files"]["step_s"] == 0.001


def test_sensors_of_two_rates(inspected):
    text = csv(omega=[f"{v:.5f}" if k % 4 == 0 else "" for k, v in enumerate(Y[:, 1])])
    told, data = inspected(text)
    assert "theta in 100 %, omega in 25 % of the rows" in told and data["files"]["min_seen"] == 0.6
    with pytest.raises(InputError, match="omega in 25 % of the rows: set min_seen"):
        all_chunks(measure(MeasurementSettings.from_mapping(data["files"] | {"min_seen": 0.7}), NAMES))


@pytest.mark.parametrize(("number", "by"), [(1, "time"), (2, "time"), (4, "random"), (12, "random")])
def test_sets_are_called_what_they_are(inspected, number, by):
    parts = [csv().splitlines()[1:] for _ in range(number)]
    text = "\n".join(["run,t,theta,omega", *(f"{k},{row}" for k, rows in enumerate(parts) for row in rows)])
    told, data = inspected(text + "\n")
    assert data["files"]["split"]["by"] == by
    titles = yaml.safe_load(told)["experiments"]["measured"]["evaluation"]["set_titles"]
    assert titles["test"] == ("test (later)" if by == "time" else "test (other trajectories)")
    assert ("on which scores depend" in told) == (number == 4)


LONG = [
    "sensor,t,value",
    *(f"{n},{t:.2f},{v:.5f}" for k, n in enumerate(("theta", "omega")) for t, v in zip(T, Y[:, k], strict=True)),
]


@pytest.mark.parametrize("order", ["by sensor", "by time"])
def test_long_tables_are_pivoted(inspected, order):
    rows = LONG[1:] if order == "by sensor" else sorted(LONG[1:], key=lambda row: float(row.split(",")[1]))
    told, data = inspected("\n".join([LONG[0], *rows]) + "\n")
    assert data["files"]["pivot"] == {"name": "sensor", "value": "value"} and "long format" in told
    np.testing.assert_allclose(rows_of(data).y, Y, atol=1e-5)


def test_long_tables_of_several_trajectories_units_and_rates(inspected):
    rows = [
        f"{run};{t:.2f};{name};{180 / np.pi * v:.5f};{unit};{k % 3}"
        for run in range(3)
        for k, (t, both) in enumerate(zip(T, Y, strict=True))
        for name, unit, v in zip(("angle", "speed"), ("deg", "deg/s"), both, strict=True)
        if name == "angle" or k % 2 == 0
    ]
    _, data = inspected("\n".join(["run;time [s];channel;reading;unit;quality", *rows]) + "\n")
    assert data["files"]["pivot"]["unit"] == "unit"
    assert data["files"]["columns"]["theta"] == {"name": "angle", "unit": "deg"}
    grid = measure(MeasurementSettings.from_mapping(data["files"]), NAMES).grid
    assert len(grid.series) == 3
    np.testing.assert_allclose(grid.series[1].rows.y[:, 0], Y[:, 0], atol=1e-5)
    assert np.isnan(grid.series[1].rows.y[1::2, 1]).all()


def test_a_sensors_second_value_of_one_moment_is_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("sensor,t,value\na,0,1\nb,0,2\na,0,3\n")
    with pytest.raises(InputError, match="row 4: another row has sensor a at t 0"):
        read_table(path, TableKeys(pivot=Pivot(name="sensor", value="value")))


@pytest.mark.parametrize("given", ["paths=x", "skip_lines", "missing=[", "columns={}"])
def test_keys_that_are_none(inspected, given):
    told, _ = inspected(csv(), "--set", given, status=2)
    assert "--set" in told and len(told.strip().splitlines()) == 1
