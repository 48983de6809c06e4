"""What inspect-data says of sensors and loggers, and the configuration that it proposes for them."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from logger_tables import T, Y, csv, rows_of
from swings import NAMES

from expertaug.errors import InputError
from expertaug.measurements.cut import all_chunks, measure
from expertaug.measurements.sensors import marks_of_nothing
from expertaug.measurements.settings import MeasurementSettings
from nightly import others_slow


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


def test_saturation_is_said(inspected):
    told, _ = inspected(csv(np.minimum(Y[:, 0], 0.6)))
    assert "'theta' stays at 0.6, an end of its range, for up to" in told
    assert "saturated" not in inspected(csv())[0] + inspected(csv(form="{:.2f}"))[0]


@pytest.mark.parametrize(("counts", "form"), [(4096, "{:.0f}"), (256, "{:.0f}"), (65536, "{:.0f}"), (1, "{:.4f}")])
def test_a_counter_that_starts_again_is_said(inspected, counts, form):
    wrapped = Y[:, 0] / (2 * np.pi) * counts % counts
    told, _ = inspected(csv([form.format(v) for v in wrapped]))
    assert f"'theta' jumps by {counts}, as a counter does that starts again" in told
    assert f"formula 2 * pi * x / {counts}" in told
    switched = (Y[:, 0] > 0).astype(int) * counts
    assert "starts again" not in inspected(csv([str(v) for v in switched]))[0], "on and off"
    assert "starts again" not in inspected(csv([form.format(v) for v in np.abs(wrapped - counts / 2)]))[0]


def test_a_reading_that_is_held_is_said(inspected):
    told, _ = inspected(csv(np.repeat(Y[::4, 0], 4)))
    assert "'theta' changes every 4 rows alone, as one that is held between its readings" in told
    assert "saturated" not in told and "'omega' changes" not in told
    for other in (np.floor(T * 2) / 10, np.sign(np.sin(np.pi * T))):  # a coarse sensor on a ramp; on and off
        assert "held between its readings" not in inspected(csv(other))[0]


def test_a_logger_that_stood_still_is_said(inspected):
    y = Y.copy()
    y[100:130] = y[100]
    told, _ = inspected(csv(y[:, 0], y[:, 1]))
    assert "'theta' stays at" in told and "for 30 rows from row 102 on, and hardly ever elsewhere" in told
    assert told.count("for 30 rows from row 102 on") == 2
    assert "hardly ever" not in inspected(csv(form="{:.1f}"))[0] + inspected(csv())[0]


def test_glitches_are_said_and_corners_are_none(inspected):
    y = Y[:, 0].copy()
    y[[50, 200, 333]] += 0.8
    told, _ = inspected(csv(y))
    assert "'theta' is far from the rows beside it in 3 rows, first in row 52" in told
    t = 0.05 * np.arange(400)
    height, ramp = np.abs(np.sin(1.3 * t)) ** 1.0, t % 3.7
    jumps = np.sign(np.sin(1.3 * t)) + 0.001 * np.sin(5 * t)
    noisy = np.random.default_rng(0).normal(0, 0.01, len(t))
    turning = (np.pi + 0.02 * np.sin(t) + noisy) % (2 * np.pi)  # noise around the end of a turn
    hopping = (0.02 * np.sin(t) + noisy) % (2 * np.pi)
    for smooth in (Y[:, 0], height, ramp, jumps, np.round(Y[:, 0], 1), turning, hopping):
        assert "far from the rows beside it" not in inspected(csv(smooth))[0]


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


@pytest.mark.parametrize("given", ["paths=x", "skip_lines", "missing=[", "columns={}"])
def test_keys_that_are_none(inspected, given):
    told, _ = inspected(csv(), "--set", given, status=2)
    assert "--set" in told and len(told.strip().splitlines()) == 1


@pytest.mark.parametrize(
    "values",
    [Y[:, 0], np.round(Y[:, 0], 1), np.r_[Y[:200, 0], 5 + Y[200:, 0]], np.where(T > 5, 1.0, 0.0), np.r_[Y[:, 0], 9.0]],
    ids=["a swing", "quantised", "two levels", "a step", "one outlier"],
)
def test_what_is_measured_is_no_mark(values):
    assert marks_of_nothing(values) == []
