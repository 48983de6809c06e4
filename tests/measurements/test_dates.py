"""Dates and durations: one reading for a whole column, a key for what cannot be decided, two columns joined."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from swings import NAMES, swing

from expertaug.cli import main
from expertaug.errors import InputError
from expertaug.measurements import dates
from expertaug.measurements.cut import measure
from expertaug.measurements.settings import Column, MeasurementSettings

Y = swing(1.0, points=120)


def table(path, header, times):
    rows = [f"{t},{a:.5f},{b:.5f}" for t, (a, b) in zip(times, Y, strict=False)]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def read(path, **given):
    time = Column(name="t", unit="datetime")
    settings = MeasurementSettings(paths=str(path), columns={"theta": "theta"}, time=time, **given)
    return measure(settings, NAMES).grid.series[0].rows.t


@pytest.mark.parametrize("form", ["%d.%m.%Y", "%d/%m/%Y", "%m/%d/%Y", "%Y-%m-%d", "%d-%m-%y"])
def test_a_day_above_12_anywhere_decides_the_order_of_all(tmp_path, form):
    dates = (np.datetime64("2024-03-01") + np.arange(40)).tolist()
    path = table(tmp_path / "a.csv", "t,theta,omega", [day.strftime(form) for day in dates])
    np.testing.assert_array_equal(read(path), 86400.0 * np.arange(40))


@pytest.mark.parametrize("order", ["%d/%m/%Y", "%m/%d/%Y"])
def test_an_order_that_nothing_decides_is_asked_for(tmp_path, capsys, order):
    path = table(
        tmp_path / "a.csv", "t,theta,omega", [f"{5 + k // 12:02d}/03/2024 {2 * (k % 12):02d}:00" for k in range(96)]
    )
    with pytest.raises(InputError, match=r"may have the day or the month first.*time_format"):
        read(path)
    assert main(["inspect-data", str(path), "--system", "pendulum", "--output", str(tmp_path / "x.png")]) == 2
    assert "--set time_format=" in capsys.readouterr().err
    asked = ["--set", f"time_format={order} %H:%M", "--output", str(tmp_path / "x.png")]
    assert main(["inspect-data", str(path), "--system", "pendulum", *asked]) == 0
    files = yaml.safe_load(capsys.readouterr().out)["experiments"]["measured"]["data"]["files"]
    assert files["time_format"] == f"{order} %H:%M"
    t = read(path, time_format=f"{order} %H:%M")
    assert t[12] == (86400.0 if order.startswith("%d") else 31 * 86400.0)


def test_cells_that_disagree_are_refused(tmp_path):
    path = table(tmp_path / "a.csv", "t,theta,omega", ["13/03/2024", "03/14/2024"])
    with pytest.raises(InputError, match="day first in '13/03/2024' and the month in '03/14/2024'"):
        read(path)


@pytest.mark.parametrize(
    ("cells", "seconds"),
    [
        (["00:00.05", "00:00.10", "01:00.00"], [0.0, 0.05, 59.95]),
        (["0:00:01", "0:01:01", "26:00:01"], [0.0, 60.0, 93600.0]),
        (["59:58", "59:59", "60:00", "75:00"], [0.0, 1.0, 2.0, 902.0]),
        (["59:59.5", "1:00:00.5"], [0.0, 1.0]),
        (["10:30:00,5", "10:30:01,0"], [0.0, 0.5]),
        (["10:30", "10:40"], [0.0, 600.0]),
    ],
)
def test_durations(tmp_path, cells, seconds):
    path = tmp_path / "a.csv"
    path.write_text("t;theta\n" + "".join(f"{cell};{k}\n" for k, cell in enumerate(cells)))
    np.testing.assert_allclose(read(path), seconds)


def test_minutes_and_seconds_or_hours_and_minutes_is_asked_for(tmp_path, capsys):
    path = table(tmp_path / "a.csv", "t,theta,omega", [f"{k // 60:02d}:{k % 60:02d}" for k in range(120)])
    command = ["inspect-data", str(path), "--system", "pendulum", "--output", str(tmp_path / "x.png")]
    assert main(command) == 2
    assert "'00:00' may be hours and minutes, or minutes and seconds" in capsys.readouterr().err
    assert main([*command, "--set", "time_format=%M:%S"]) == 0
    assert "step: 1 s" in capsys.readouterr().out


@pytest.mark.parametrize("form", ["%d.%m.%Y", "%Y-%m-%d 00:00:00", "%m/%d/%y"])
def test_date_and_time_in_two_columns_are_joined(tmp_path, capsys, form):
    moments = (np.datetime64("2024-03-30T20:00") + 600 * np.arange(120).astype("timedelta64[s]")).tolist()
    path = table(
        tmp_path / "a.csv", "Date,Time,theta,omega", [moment.strftime(f"{form},%H:%M:%S") for moment in moments]
    )
    assert main(["inspect-data", str(path), "--system", "pendulum", "--output", str(tmp_path / "x.png")]) == 0
    files = yaml.safe_load(capsys.readouterr().out)["experiments"]["measured"]["data"]["files"]
    assert files["date"] == "Date" and files["time"] == {"name": "Time", "unit": "datetime"}
    data = measure(MeasurementSettings.from_mapping(files), NAMES)
    np.testing.assert_allclose(data.grid.series[0].rows.t, 600.0 * np.arange(120))


def test_a_format_reads_dates_without_separators(tmp_path):
    path = table(tmp_path / "a.csv", "t,theta,omega", ["20240228", "20240229", "20240301"])
    np.testing.assert_array_equal(read(path, time_format="%Y%m%d"), 86400.0 * np.arange(3))
    with pytest.raises(InputError, match=r"row 2, column t: '20240228' is no date and time; .* is '%Y-%m'"):
        read(path, time_format="%Y-%m")


def test_moments_are_seconds_from_the_first_on_and_what_is_none_is_told():
    cells = np.array(["2024-02-28 23:59:59", "noon", "2024-03-01"], dtype=object)
    found, none = dates.seconds(Path("a.csv"), "t", cells, None)
    assert none.tolist() == [False, True, False] and found[[0, 2]].tolist() == [0.0, 86401.0]


def test_the_time_of_day_that_a_spreadsheet_adds_to_a_date_gives_way_to_the_clocks():
    joined = dates.join_texts(np.array(["01.03.2024 00:00:00", "02.03.2024"]), np.array(["10:30", "11:00"]))
    assert joined.tolist() == ["01.03.2024 10:30", "02.03.2024 11:00"]
