"""Rows that lie on no grid keep their times: on a finer one, to half of its step."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from swings import NAMES, settings, swing, table

import expertaug as ea
from expertaug.errors import InputError
from expertaug.measurements.cut import all_chunks, candidates, divide, measure, trajectories_of

FINE = 0.005
NOISE = 0.002


@pytest.fixture(scope="module")
def rows(tmp_path_factory) -> tuple[Path, dict[str, np.ndarray]]:
    """Six trials, rows at random times .02 to .08 s apart, a pause of a second in each."""
    rng, parts = np.random.default_rng(0), []
    for trial in range(6):
        steps = rng.integers(4, 17, size=160)
        steps[80] = 200
        at = np.concatenate(([0], np.cumsum(steps)))
        y = swing(0.3 + 0.2 * trial, points=int(at[-1]) + 1, step=FINE)[at]
        t = at * FINE + rng.uniform(-0.3, 0.3, size=len(at)) * FINE
        parts.append(np.column_stack((np.full(len(at), trial), t, y + NOISE * rng.standard_normal(y.shape))))
    every = dict(zip(("trial", "t", "angle", "speed"), np.concatenate(parts).T, strict=True))
    return table(tmp_path_factory.mktemp("lab") / "swings.csv", every), every


def own(path: Path, **given: object):
    return settings(path, **{"uneven": "own", "step_s": FINE, "length": 401, "stride": 40, **given})


def test_every_row_is_at_its_time(rows):
    path, every = rows
    data = measure(own(path), NAMES)
    assert 0 < data.grid.moved <= FINE / 2
    chosen = candidates(data, divide(data)[0])["train"]
    found = trajectories_of(data, chosen)
    assert len(found) > 20 and found.mask[:, 0].all(), "chunks begin at rows"
    assert np.diff(found.t) == pytest.approx(FINE)
    assert 0.05 < found.mask.mean() < 0.2, "between rows nothing was measured"
    for y, mask, (index, first) in zip(found.y, found.mask, chosen, strict=True):
        points = np.flatnonzero(mask[:, 0])
        of = every["trial"] == index
        begin = every["t"][of][data.grid.series[index].row[first]]
        places = np.searchsorted(every["t"][of], begin + points * FINE - FINE)
        np.testing.assert_allclose(every["t"][of][places], begin + points * FINE, atol=FINE)
        np.testing.assert_allclose(y[points, 0], every["angle"][of][places], atol=1e-6)
    starts = chosen[:, 1][chosen[:, 0] == chosen[0, 0]]
    assert (np.diff(starts) >= 40).all()


def test_no_chunk_spans_the_pause_and_noise_is_found(rows):
    data = measure(own(rows[0]), NAMES)
    found = trajectories_of(data, candidates(data, divide(data)[0])["train"])
    longest = max(np.diff(np.flatnonzero(mask[:, 0])).max() for mask in found.mask)
    assert longest <= 6.5 * 10 + 1
    assert found.noise[0] == pytest.approx(NOISE, rel=0.25)
    assert NOISE < found.noise[1] < 1.6 * NOISE, "an upper estimate: speeds bend more over seven rows"


@pytest.mark.slow
def test_a_solver_at_their_own_times_finds_the_frequency(rows):
    lab = {"columns": {"theta": "angle", "omega": "speed"}, "trajectory": "trial", "length": 401, "stride": 100}
    lab |= {"uneven": "own", "step_s": FINE}
    chunks = ea.read_measurements(rows[0], ea.DampedPendulum(), **lab)
    model = ea.least_squares(
        ea.DampedPendulum(), chunks, observed_s=2.0, prior={"omega0": (1.0, 3.0)}, noise=NOISE, starts=8, tries=1
    )
    found = model.forecast(chunks.seen[:8], chunks.t).z_e["omega0"]
    assert found == pytest.approx(np.full(8, 2.0), rel=0.02), "a damping of .1 /s is not in the expert"


@pytest.mark.parametrize(
    ("step_s", "told"),
    [(0.05, r"share a point; give less than"), (0.5, r"step_s: found 0.5, rows are usually .* give less")],
)
def test_a_grid_that_is_too_coarse(rows, step_s, told):
    with pytest.raises(InputError, match=told):
        measure(own(rows[0], step_s=step_s, length=41), NAMES)


def test_rows_that_no_chunk_can_hold_are_told(rows, caplog):
    """The last sample, a day after the others, is alone behind a gap that ends a stretch."""
    path, every = rows
    trials = sorted(set(every["trial"]))
    late = np.array([[one, 10 * every["t"].max(), 0.1, 0.0] for one in trials])
    longer = {name: np.concatenate((of, late[:, k])) for k, (name, of) in enumerate(every.items())}
    longer = table(path.parent / "late.csv", longer)
    given = {"columns": {"theta": "angle", "omega": "speed"}, "trajectory": "trial", "uneven": "own", "step_s": FINE}
    ea.read_measurements(path, ea.DampedPendulum(), **given, length=101)
    assert not caplog.records
    ea.read_measurements(path, ea.DampedPendulum(), **given, length=801)
    (said,) = caplog.messages
    assert "rows lie in stretches shorter than the 801 points" in said and "longest_gap" in said
    data = measure(own(longer, length=101), NAMES)
    assert not data.told_short(), "one row in a hundred and sixty is not worth a word"
    data = measure(own(longer, length=401, longest_gap=20), NAMES)
    assert not data.told_short()


def test_where_no_chunk_has_enough_the_most_complete_ones_share_is_said(rows, tmp_path):
    every = {**rows[1], "speed": np.where(np.arange(len(rows[1]["speed"])) % 2, rows[1]["speed"], np.nan)}
    path = table(tmp_path / "half.csv", every)
    with pytest.raises(InputError, match=r"the most complete chunk has [\d.]+: give that or less") as refused:
        all_chunks(measure(own(path, min_seen=1.0), NAMES))
    share = float(str(refused.value).partition("complete chunk has ")[2].partition(":")[0])
    assert len(all_chunks(measure(own(path, min_seen=share), NAMES)).y)
    with pytest.raises(InputError, match="min_seen"):
        all_chunks(measure(own(path, min_seen=share + 0.02), NAMES))


def test_times_that_alternate_or_come_at_random_leave_long_chunks(tmp_path):
    """The median step is far below the mean one, by which alone most points of a chunk would count as missing."""
    bursts = np.random.default_rng(1).choice((2, 12), p=(0.6, 0.4), size=800)
    for k, at in enumerate((np.cumsum(np.tile((9, 3), 400)), np.cumsum(bursts))):
        y = swing(0.6, points=int(at[-1]) + 1, step=FINE)[at]
        columns = {"trial": np.zeros(len(at)), "t": at * FINE, "angle": y[:, 0], "speed": y[:, 1]}
        data = measure(own(table(tmp_path / f"{k}.csv", columns)), NAMES)
        assert len(candidates(data, divide(data)[0])["train"]) > 20
