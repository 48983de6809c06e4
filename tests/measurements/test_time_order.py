"""Tables whose times go back: rows out of order are sorted, experiments that follow each other are never mixed."""

from pathlib import Path

import numpy as np
import pytest

from expertaug.cli import main
from expertaug.errors import InputError
from expertaug.measurements.table import Table
from expertaug.measurements.time_order import check_sortable, is_since_1970

T = np.arange(60) * 0.05
THETA, OMEGA = np.cos(2 * T), -2 * np.sin(2 * T)


def table(path, header, rows):
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def runs(folder, number=4, rows=60):
    each = [(t, a / k, b / k) for k in range(1, number + 1) for t, a, b in zip(T[:rows], THETA, OMEGA, strict=False)]
    return table(folder / "runs.csv", "t,theta,omega", each)


def long(folder, by_sensor):
    values = [(t, name, v) for name, of in (("a", THETA), ("b", OMEGA)) for t, v in zip(T, of, strict=True)]
    return table(folder / "long.csv", "t,sensor,theta", values if by_sensor else sorted(values))


def counter(folder, wrap=1000):
    return table(folder / "counter.csv", "t,theta", [((50 * k) % wrap, v) for k, v in enumerate(THETA)])


def midnight(folder):
    times = [divmod(86370 + k, 86400)[1] for k in range(60)]
    clock = [f"{s // 3600:02d}:{s // 60 % 60:02d}:{s % 60:02d}" for s in times]
    return table(folder / "midnight.csv", "Time,theta", zip(clock, THETA, strict=True))


@pytest.mark.parametrize(
    ("made", "found"),
    [
        (runs, "row 62: the time goes back by 2.95 s, from 2.95 to 0 s, as if 4 trajectories"),
        (lambda folder: runs(folder, 2), "row 62: the time goes back by 2.95 s"),
        (lambda folder: runs(folder, 12, 3), "times go back and come again"),
        (lambda folder: long(folder, True), "column 'sensor' tells up to 2 rows of one time apart"),
        (lambda folder: long(folder, False), "column 'sensor' tells up to 2 rows of one time apart"),
        (counter, "row 22: the time goes back by 950 s, from 950 to 0 s"),
        (midnight, "row 32: the time goes back by 86399 s"),
    ],
    ids=["runs", "two runs", "short runs", "long by sensor", "long by time", "counter", "midnight"],
)
def test_what_follows_each_other_is_never_mixed(made, found, tmp_path, capfd):
    assert main(["inspect-data", str(made(tmp_path)), "--system", "pendulum"]) == 2
    said = capfd.readouterr()
    assert found in said.err and "unordered" not in said.out and "mean" not in said.out
    assert len(said.err.strip().splitlines()) == 1


@pytest.mark.parametrize("order", ["swapped", "shuffled", "backwards"])
def test_rows_that_are_merely_out_of_order_are_sorted(order, tmp_path, capfd):
    index = np.arange(60)
    if order == "swapped":
        index[[20, 21]] = index[[21, 20]]
    elif order == "shuffled":
        index = np.random.default_rng(0).permutation(60)
    else:
        index = index[::-1]
    path = table(tmp_path / "one.csv", "t,theta,omega", [(T[k], THETA[k], OMEGA[k]) for k in index])
    assert main(["inspect-data", str(path), "--system", "pendulum"]) == 0
    assert "unordered: sort" in capfd.readouterr().out


def test_a_column_that_tells_trajectories_apart_is_enough(tmp_path, capfd):
    rows = [(k, t, a) for k in range(3) for t, a in zip(T, THETA, strict=True)]
    path = table(tmp_path / "trials.csv", "trial,t,theta", rows)
    assert main(["inspect-data", str(path), "--system", "pendulum"]) == 0
    assert "unordered" not in capfd.readouterr().out


def test_rows_of_one_time_that_nothing_tells_apart_may_still_be_averaged(tmp_path, capfd):
    rows = [(t, a + e, b) for t, a, b in zip(T, THETA, OMEGA, strict=True) for e in (0.0, 1e-3)]
    assert (
        main(["inspect-data", str(table(tmp_path / "twice.csv", "t,theta,omega", rows)), "--system", "pendulum"]) == 0
    )
    assert "duplicates: mean" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("times", "found"),
    [
        (1.7e12 + 50 * np.arange(60), "starts at 1700000000000 without a unit, as if it counted ms since 1970"),
        (1.7e15 + 50000 * np.arange(60), "as if it counted us since 1970"),
        (45000.25 + np.arange(60) * 0.05 / 86400, "as a spreadsheet's days do"),
        (20240501 + np.arange(30), r"as if it held dates (yyyymmdd)"),
    ],
    ids=["ms", "us", "spreadsheet", "dates"],
)
def test_a_moment_without_a_unit_is_not_taken_for_seconds(times, found, tmp_path, capfd):
    path = table(tmp_path / "x.csv", "time,theta,omega", zip(map(repr, times.tolist()), THETA, OMEGA, strict=False))
    assert main(["inspect-data", str(path), "--system", "pendulum"]) == 2
    assert found in capfd.readouterr().err


@pytest.mark.parametrize("times", [1.7e9 + T, 40000 + T, 20240501 + T, T, 1e4 * np.arange(60)])
def test_seconds_are_seconds(times, tmp_path, capfd):
    path = table(tmp_path / "x.csv", "time,theta,omega", zip(map(repr, times.tolist()), THETA, OMEGA, strict=True))
    assert main(["inspect-data", str(path), "--system", "pendulum"]) == 0
    assert "s is assumed" in capfd.readouterr().out


def test_a_unit_that_is_told_is_believed(tmp_path, capfd):
    times = 1.7e12 + 50 * np.arange(60)
    path = table(tmp_path / "x.csv", "time,theta,omega", zip(map(repr, times.tolist()), THETA, OMEGA, strict=True))
    assert main(["inspect-data", str(path), "--system", "pendulum", "--unit", "time=ms"]) == 0
    assert "step: 0.05 s" in capfd.readouterr().out


def test_what_counts_since_1970_is_told_by_its_size():
    assert [is_since_1970(1.7e9 * factor) for factor in (1, 1e3, 1e6, 1e9)] == [None, "ms", "us", "ns"]


def test_pieces_that_do_not_overlap_are_put_in_order_where_somebody_asks_for_it():
    halves, rows = np.r_[T[30:], T[:30]], [np.arange(60)]
    seen = Table(Path("a.csv"), {"t": halves}, np.arange(2, 62))
    check_sortable(seen, halves, rows, apart=True)
    with pytest.raises(InputError, match=r"row 32: the time goes back by 2.95 s, .* as if 2 trajectories followed"):
        check_sortable(seen, halves, rows)
