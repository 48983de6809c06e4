"""Tables of estimates: means, errors and intervals against closed forms and simulations, and the files of a run."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from expertaug import plotting
from expertaug.config import jobs
from expertaug.config import load as config
from expertaug.evaluation.estimates import (
    ALL,
    SHARED,
    Stated,
    TabledEstimate,
    correlation_time,
    draw,
    estimates,
    interval,
    of_trajectory,
    places_by_trajectory,
    pool,
    run_stage,
    summarise,
    table,
)
from expertaug.evaluation.forecasts import Forecasts, SetForecasts, VersionKey
from expertaug.evaluation.settings import EstimatesJob
from expertaug.models.posterior import Estimates, Gaussian, Posterior
from expertaug.systems import Parameter
from expertaug.versions import LINES

ROOT = Path(__file__).parents[2]
RANGES = {"omega0": (1.0, 3.0)}


def overlapping(rng, count, width):
    """Means of windows that share all but one of their values: standard normal, correlated over ``width``."""
    return np.convolve(rng.normal(size=count + width - 1), np.ones(width) / np.sqrt(width), "valid")


def test_of_one_block_many_windows_say_as_much_as_one():
    found = pool(np.full(5, 3.0), np.full(5, 0.2), np.zeros(5, dtype=int))
    assert found.error == pytest.approx(0.2) and found.groups == 1
    assert interval(found) == pytest.approx((3 - 1.645 * 0.2, 3 + 1.645 * 0.2), abs=1e-4)


def test_an_interval_of_what_cannot_be_negative_ends_at_zero():
    """Of two trajectories Student's t is six errors wide."""
    values = np.array([[[0.2, -1.0], [0.6, 1.0]]])
    stated = Stated(values, None, ["mass", "speed"], ["kg", "m/s"], None, {}, positive=["mass"])
    mass, speed = summarise(stated, {})
    assert mass.low == 0.0 and mass.high == pytest.approx(0.4 + 6.314 * 0.2, abs=1e-3)
    assert speed.low == pytest.approx(-6.314, abs=1e-3)
    assert interval(pool(np.array([3.0, 3.2]), np.array([0.1, 0.1])), True)[0] > 0


def test_correlation_times_of_overlapping_windows():
    rng = np.random.default_rng(0)
    assert correlation_time(overlapping(rng, 2000, 1)) < 1.5
    assert 6 < correlation_time(overlapping(rng, 2000, 10)) < 14
    assert correlation_time(np.array([1.0, 2.0])) == 2


@pytest.mark.parametrize(("count", "width"), [(60, 1), (60, 5), (112, 15)])
def test_intervals_of_a_trajectory_hold(count, width):
    rng, held = np.random.default_rng(1), 0
    for _ in range(200):
        low, high = interval(of_trajectory(overlapping(rng, count, width), np.ones(count)))
        held += low <= 0 <= high
    assert 0.82 < held / 200 < 0.99


def test_a_trajectorys_windows_are_in_the_order_of_their_rows():
    found = places_by_trajectory(np.array(["run/b/10", "run/b/9", "a/3", "run/b/100"]), 4)
    assert {name: places.tolist() for name, places in found.items()} == {"run/b": [1, 0, 3], "a": [2]}


def stated(identity=None, shared=None, count=40, seed=0, names=("omega0", "alpha"), seeds=1):
    rng = np.random.default_rng(seed)
    values = np.array([2.0, 0.1]) + np.array([0.05, 0.01]) * rng.normal(size=(seeds, count, 2))
    errors = np.broadcast_to([0.05, 0.01], values.shape)
    return Stated(values, errors, names, ["rad/s", "1/s"], identity, shared or {})


def test_shared_parameters_stand_once_and_others_by_trajectory():
    identity = np.array([f"run{k % 4}/{k}" for k in range(40)])
    found = summarise(stated(identity, {"omega0": 8}), RANGES)
    rows = {(one.parameter, one.of): one for one in found}
    assert list(rows) == [("omega0", SHARED), ("alpha", ALL), *(("alpha", f"run{k}") for k in range(4))]
    assert rows["omega0", SHARED].told is True and rows["alpha", ALL].told is None
    assert rows["omega0", SHARED].groups == 8 and rows["alpha", "run1"].windows == 10
    assert abs(rows["alpha", ALL].value - 0.1) < 3 * rows["alpha", ALL].error


def test_what_windows_cannot_tell_is_told():
    vague = stated()
    vague = Stated(vague.values, 100 * vague.errors, vague.names, vague.units, None, {})
    assert [one.told for one in summarise(vague, RANGES)] == [False, None]
    assert [one.told for one in summarise(stated(), RANGES)] == [True, None]
    assert [one.parameter for one in summarise(stated(), RANGES, ["omega0"])] == ["alpha"]


def test_a_trajectory_of_one_window_keeps_its_own_error():
    """Also where some windows leave a parameter open, whose mean then weighs all alike."""
    values, errors = np.array([[[2.0], [2.1], [2.9]]]), np.array([[[0.1], [0.2], [5.0]]])
    identity = np.array(["a/0", "b/0", "c/0"])
    found = summarise(Stated(values, errors, ["omega0"], ["rad/s"], identity, {}), RANGES)
    assert [one.of for one in found] == [ALL, "a", "b", "c"] and found[0].told is False
    assert [one.error for one in found[1:]] == pytest.approx([0.1, 0.2, 5.0])
    assert found[0].error > 1 and found[0].value == pytest.approx(values.mean())


def test_seeds_that_differ_widen_the_error():
    one = stated(seeds=2)
    apart = Stated(one.values + np.array([0.0, 1.0])[:, None, None], one.errors, one.names, one.units, None, {})
    near, far = (summarise(each, {})[0].error for each in (one, apart))
    assert far > 0.4 > 10 * near


def test_z_a_of_a_true_equation_is_stated_too():
    z_e = Gaussian(torch.zeros(1, 3, 1), torch.zeros(1, 3, 1) - 2, [Parameter("omega0", "rad/s")])
    z_a = Gaussian(torch.ones(1, 3, 1), torch.zeros(1, 3, 1) - 1)
    found = Estimates(torch.zeros(1, 3, 2), z_e.mean, z_a.mean, Posterior(z_e, z_a))
    values, std = found.stated(True)
    assert values.shape == std.shape == (1, 3, 2)
    torch.testing.assert_close(std[..., 1], torch.full((1, 3), float(np.exp(-1))))
    torch.testing.assert_close(found.stated(False)[1], std[..., :1])


def write(path: Path, method: str, one: Stated, sets=("train", "test")) -> Path:
    size = one.values.shape[1] // len(sets)
    found = {}
    for k, name in enumerate(sets):
        part = slice(k * size, (k + 1) * size)
        identity = None if one.identity is None else one.identity[part]
        numbers = {"errors": np.ones((1, size)), "misfit": np.ones((1, size)), "z_e": np.full((size, 2), np.nan)}
        estimated = {"estimated": one.values[:, part], "estimated_std": one.errors[:, part], "sample_id": identity}
        found[name] = SetForecasts(**numbers, **estimated)
    forecasts = Forecasts(
        t=np.arange(3.0),
        observed=1,
        seeds=[0],
        state_names=["theta"],
        state_units=["rad"],
        parameter_names=list(one.names),
        parameter_units=list(one.units),
        sets=found,
        estimated_names=list(one.names),
        estimated_units=list(one.units),
        shared=one.shared,
        version=VersionKey("swings", "corrected", method),
    )
    forecasts.save(path)
    assert Forecasts.load(path).shared == one.shared
    return path


def test_the_table_of_measured_trajectories_and_of_simulated_windows(tmp_path):
    identity = np.array([f"run{k % 3}/{k}" for k in range(40)])
    job = EstimatesJob(labels=[("own", "Own"), ("together", "Together")], priors={"own": RANGES, "together": RANGES})
    for name, known, rows in (("measured", identity, 2 * 4 + 1 + 4), ("simulated", None, 2 + 1 + 1)):
        files = [write(tmp_path / f"{name}_a.npz", "own", stated(known))]
        files.append(write(tmp_path / f"{name}_b.npz", "together", stated(known, {"omega0": 9})))
        outputs = [tmp_path / f"{name}_estimates.{end}" for end in ("csv", "md", "tex", "png")]
        run_stage(files, outputs, job)
        table = pd.read_csv(outputs[0])
        assert len(table) == rows, table
        assert (table["of"] == SHARED).sum() == 1
        text = outputs[1].read_text()
        assert "Together" in text and "omega0 [rad/s]" in text and "nan" not in text
    assert set(table["of"]) == {SHARED, "test (OOD)"}  # the training set's windows are no population of their own


def test_where_nothing_is_stated_the_table_says_so(tmp_path):
    own = Forecasts.load(write(tmp_path / "a.npz", "own", stated()))
    study = estimates([own], EstimatesJob(labels=[("other", "Other")]))
    assert study.figure().get_label() == plotting.NOTE
    assert "No version states parameters" in study.markdown()


def test_initial_speeds_are_no_constants_and_what_has_no_expert_states_nothing():
    found = config.validate(config.load([ROOT / "config" / "config.yaml"]))
    assert jobs.estimating(found, "double_pendulum") == []
    versions = jobs.estimating(found, "pendulum")
    assert {"least_squares", "truth", "aphynity+"} <= set(versions) and not {"mean", "ml_only"} & set(versions)


def test_of_many_versions_and_sets_the_figure_shows_some_and_the_table_all():
    versions = [f"method{k}" for k in range(10)]
    job = EstimatesJob(labels=[(v, v.upper()) for v in versions])
    sets = ("validation", "iid", "test", "near", "far")
    (first, *_) = summarise(stated(np.array([f"run/{k}" for k in range(40)])), {})
    rows = [
        replace(TabledEstimate(v, v.upper(), **vars(first)), of=job.of_set(name)) for v in versions for name in sets
    ]
    names = [tick.get_text() for tick in draw(rows, job, "swings").axes[0].get_yticklabels()]
    assert names == [f"{v.upper()}, {job.of_set(name)}" for v in versions[:LINES] for name in ("iid", "test")]
    assert table(rows).size == len(rows)


@pytest.mark.parametrize(("trajectories", "lines"), [(3, [", all", ", run0", ", run1", ", run2"]), (40, [""])])
def test_of_many_trajectories_the_figure_shows_all_together(trajectories, lines):
    identity = np.array([f"run{k % trajectories}/{k}" for k in range(40)])
    rows = [TabledEstimate("own", "Own", **vars(one)) for one in summarise(stated(identity), {})]
    figure = draw(rows, EstimatesJob(labels=[("own", "Own")]), "swings")
    names = [[tick.get_text() for tick in axes.get_yticklabels()] for axes in figure.axes]
    assert names == [[f"Own{line}" for line in lines]] * 2
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    spread = ["spread between trajectories or windows"] if any(one.spread > 0 for one in rows) else []
    assert labels == ["90 % interval", *spread] and figure.get_suptitle() == "swings"


def test_a_constant_of_a_sensor_is_that_of_a_state():
    numbers = {"error": 0.1, "low": 0.9, "high": 1.1, "spread": np.nan, "windows": 9, "groups": 3, "told": None}
    row = TabledEstimate("own", "Own", "scale of omega", "", "real_pend_h_1/0", 1.0, **numbers)
    (axis,) = draw([row], EstimatesJob(labels=[("own", "Own")]), "swings").axes
    assert axis.get_xlabel() == r"scale of $\omega$ [1]"
    assert [tick.get_text() for tick in axis.get_yticklabels()] == ["Own"]


def test_the_first_of_several_trajectories_keeps_its_number():
    numbers = {"error": 0.1, "low": 0.9, "high": 1.1, "spread": np.nan, "windows": 9, "groups": 3, "told": None}
    names = ("swings/0", "swings/1", "other/0")
    rows = [TabledEstimate("own", "Own", "omega0", "rad/s", name, 1.0, **numbers) for name in names]
    (axis,) = draw(rows, EstimatesJob(labels=[("own", "Own")]), "swings").axes
    assert [tick.get_text() for tick in axis.get_yticklabels()] == ["Own, swings/0", "Own, swings/1", "Own, other"]
