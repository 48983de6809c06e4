"""Times even and uneven, gaps, rows out of order and rows twice; what is not measured stays masked."""

import numpy as np
import pytest
from swings import NAMES, STEP, settings, swing, table, trials

from expertaug.errors import InputError
from expertaug.measurements.cut import all_chunks, measure
from expertaug.measurements.grid import round_step, times_of


def one_swing(folder, keep=slice(None), t=None, **more):
    y = swing(1.0)
    t = STEP * np.arange(200) if t is None else t
    rows = {"t": t, "angle": y[:, 0], "speed": y[:, 1]} | more
    return y, table(folder / "a.csv", {name: np.asarray(values)[keep] for name, values in rows.items()})


@pytest.mark.parametrize("seed", range(5))
def test_gaps_are_masked_and_what_is_left_is_untouched(tmp_path, seed):
    keep = np.sort(np.random.default_rng(seed).permutation(200)[:170])
    y, path = one_swing(tmp_path, keep)
    data = measure(settings(path, trajectory=None, stride=1, min_seen=0.0), NAMES)
    chunks = all_chunks(data)
    first = [keep[int(name.rpartition("/")[2]) - 2] for name in chunks.id]
    for k, start in enumerate(first):
        there = np.isin(start + np.arange(20), keep)
        assert np.array_equal(chunks.mask[k].all(1), there) and np.array_equal(chunks.mask[k].any(1), there)
        assert np.allclose(chunks.y[k][there], y[start + np.flatnonzero(there)], atol=1e-6)
    assert data.grid.row_s == STEP


def test_a_long_gap_ends_a_trajectory(tmp_path):
    keep = np.r_[0:80, 120:200]
    _, path = one_swing(tmp_path, keep)
    given = settings(path, trajectory=None, stride=1, longest_gap=5)
    starts = [keep[int(name.rpartition("/")[2]) - 2] for name in all_chunks(measure(given, NAMES)).id]
    assert max(s for s in starts if s < 80) == 60 and min(s for s in starts if s > 80) == 120


def test_rows_in_which_nothing_was_measured_are_a_gap_too(tmp_path):
    y = swing(1.0)
    y[:30] = y[80:120] = np.nan
    path = table(tmp_path / "a.csv", {"t": STEP * np.arange(200), "angle": y[:, 0], "speed": y[:, 1]})
    for longest, expected in ((5, [30, 50, 120]), (40, [40, 60])):
        given = settings(path, trajectory=None, stride=20, longest_gap=longest, min_seen=0.4)
        starts = [int(name.rpartition("/")[2]) - 2 for name in all_chunks(measure(given, NAMES)).id]
        assert starts[: len(expected)] == expected, longest


def test_empty_cells_are_masked_alone(tmp_path):
    speed = swing(1.0)[:, 1].copy()
    speed[7] = np.nan
    _, path = one_swing(tmp_path, speed=speed)
    chunk = all_chunks(measure(settings(path, trajectory=None), NAMES)).subset([0])
    assert (~chunk.mask).nonzero()[1].tolist() == [7] and (~chunk.mask).nonzero()[2].tolist() == [1]


def test_unmeasured_components_are_masked_and_unknown_parameters_unknown(tmp_path):
    path = trials(tmp_path)
    found = all_chunks(measure(settings(path, columns={"theta": "angle"}), NAMES))
    assert found.mask[..., 0].all() and not found.mask[..., 1].any() and np.isnan(found.z_e).all()
    assert found.noise[1] == 0


def test_jitter_within_the_tolerance_is_put_up_with_and_beyond_it_refused(tmp_path):
    rng = np.random.default_rng(0)
    t = STEP * (np.arange(200) + 0.04 * rng.uniform(-1, 1, 200))
    _, path = one_swing(tmp_path, t=t)
    data = measure(settings(path, trajectory=None, columns={"theta": "angle"}), NAMES)
    assert data.grid.row_s == pytest.approx(STEP, rel=1e-3) and data.grid.broken == 0
    t = STEP * (np.arange(200) + 0.4 * rng.uniform(-1, 1, 200))
    _, path = one_swing(tmp_path, t=t)
    with pytest.raises(InputError, match=r"off a grid; set uneven to own or interpolate"):
        measure(settings(path, trajectory=None), NAMES)


def test_interpolation_says_its_error_and_keeps_it(tmp_path):
    rng, fine = np.random.default_rng(0), swing(1.0, points=2000, step=STEP / 10)
    place = 10 * np.arange(1, 199) + rng.integers(-4, 5, 198)
    t = STEP / 10 * place
    path = table(tmp_path / "a.csv", {"t": t, "angle": fine[place, 0]})
    given = settings(path, trajectory=None, columns={"theta": "angle"}, uneven="interpolate", step_s=STEP, min_seen=0.0)
    data = measure(given, NAMES)
    one = data.grid.series[0]
    known = np.isfinite(one.y[:, 0])
    at = np.rint(one.t[known] / (STEP / 10)).astype(int)
    error = np.sqrt(np.mean((one.y[known, 0] - fine[at, 0]) ** 2))
    assert known.mean() > 0.9 and 0 < error < 3 * data.grid.error[0] < 0.05


@pytest.mark.parametrize("unordered", ["sort", "refuse"])
def test_rows_out_of_order(tmp_path, unordered):
    order = np.random.default_rng(0).permutation(200)
    y, path = one_swing(tmp_path, order)
    given = settings(path, trajectory=None, unordered=unordered)
    if unordered == "refuse":
        with pytest.raises(InputError, match=r"row \d+: the time goes back .* set unordered to sort"):
            measure(given, NAMES)
    else:
        assert np.allclose(all_chunks(measure(given, NAMES)).y[0], y[:20], atol=1e-6)


def test_rows_twice(tmp_path):
    keep = np.r_[0:50, 49, 50:200]
    y, path = one_swing(tmp_path, keep)
    assert measure(settings(path, trajectory=None), NAMES).grid.series[0].rows.repeated == 1  # they say the same
    other = swing(1.0)[keep]
    other[50, 0] += 0.2
    path = table(tmp_path / "a.csv", {"t": STEP * keep, "angle": other[:, 0], "speed": other[:, 1]})
    with pytest.raises(InputError, match=r"row 52: another row has its time"):
        measure(settings(path, trajectory=None), NAMES)
    for how, expected in (("first", y[49, 0]), ("mean", y[49, 0] + 0.1)):
        found = measure(settings(path, trajectory=None, duplicates=how), NAMES).grid.series[0]
        assert found.y[49, 0] == pytest.approx(expected, abs=1e-9)


def test_wrapped_angles_are_unwrapped_and_begin_within_half_a_turn(tmp_path):
    theta = 0.3 * np.arange(200) + 3.0
    wrapped = np.angle(np.exp(1j * theta))
    path = table(tmp_path / "a.csv", {"t": STEP * np.arange(200), "angle": wrapped})
    given = settings(path, trajectory=None, columns={"theta": "angle"}, angles=["theta"])
    found = all_chunks(measure(given, NAMES)).y[..., 0]
    assert np.allclose(np.diff(found), 0.3, atol=1e-5) and (np.abs(found[:, 0]) <= np.pi + 1e-6).all()


def test_a_coarser_step_takes_every_nth_row_from_each_phase(tmp_path):
    y, path = one_swing(tmp_path)
    given = settings(path, trajectory=None, step_s=4 * STEP, stride=1)
    found = all_chunks(measure(given, NAMES))
    assert np.allclose(found.y[1], y[1:78:4], atol=1e-6) and found.t[1] == pytest.approx(4 * STEP)
    with pytest.raises(InputError, match=r"rows are 0\.05 s apart"):
        measure(settings(path, trajectory=None, step_s=0.07), NAMES)


def test_a_grid_is_found_where_every_second_row_or_more_is_missing(tmp_path):
    keep = [k for k in range(200) if k % 5 in (0, 2, 4)]  # steps of two, two and one
    y, path = one_swing(tmp_path, keep)
    data = measure(settings(path, trajectory=None, stride=1, min_seen=0.5), NAMES)
    assert data.grid.row_s == pytest.approx(STEP) and data.grid.broken == 0
    chunks = all_chunks(data)
    assert chunks.mask.mean() == pytest.approx(0.6, abs=0.05)
    assert np.allclose(chunks.y[0][chunks.mask[0]], y[:20][chunks.mask[0]], atol=1e-6)


def test_a_step_or_its_rate_is_of_few_digits_where_one_is_near():
    assert round_step(0.05 * (1 + 1e-8)) == 0.05 and round_step((1 + 1e-8) / 30) == 1 / 30
    assert round_step(0.01237123456789) == 0.0123712346
    assert times_of(36, 0.01)[35] == 0.35 != 35 * 0.01
