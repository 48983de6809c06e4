"""Few rows at uneven times, as blood samples are: each trajectory is one chunk, from its first row on."""

from __future__ import annotations

import inspect
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from swings import STEP, swing, table

import expertaug as ea
from expertaug import systems
from expertaug.cli import main
from expertaug.errors import InputError
from expertaug.measurements.cut import measure
from expertaug.measurements.names import Names
from expertaug.measurements.settings import MeasurementSettings
from expertaug.measurements.windows import latest_windows
from expertaug.systems.base import Parameter, System

SAMPLED = np.array([0.0, 0.25, 0.55, 1.1, 2.0, 3.6, 5.1, 7.0, 9.0, 12.1, 24.2])
READ = {"columns": {"conc": "conc"}, "time": "Time", "trajectory": "Subject", "inputs": {"dose": "Dose"}}
READ |= {"uneven": "own", "step_s": 0.01, "whole": True}


class Tablet(System):
    """A dose is absorbed and eliminated: dC/dt = dose ka exp(−ka t) / V − ke C."""

    state = (Parameter("conc", "mg/L"),)
    expert_parameters = (Parameter("ka", "1/h"), Parameter("ke", "1/h"), Parameter("V", "L/kg"))
    covariates = (Parameter("dose", "mg/kg"),)

    def expert(self, t, y, z_e, u):
        ka, ke, v = z_e.unbind(-1)
        return (u[..., 0] * ka / v * torch.exp(-ka * t) - ke * y[..., 0]).unsqueeze(-1)


NAMES = Names({"conc": "mg/L"}, {"ka": "1/h", "ke": "1/h", "V": "L/kg"}, {"dose": "mg/kg"}, frozenset({"dose"}))


@pytest.fixture(scope="module")
def sampled(tmp_path_factory) -> tuple[Path, np.ndarray]:
    """Eight subjects' samples at their own times, one of whom leaves early, and the true (ka, ke, V), (8, 3)."""
    rng, rows = np.random.default_rng(0), {name: [] for name in ("Subject", "Wt", "Dose", "Time", "conc")}
    true = np.exp(rng.normal(np.log([1.5, 0.09, 0.45]), [0.3, 0.1, 0.1], (8, 3)))
    for subject, (ka, ke, v) in enumerate(true):
        t = SAMPLED.copy()
        t[1:] = np.round(t[1:] + rng.integers(-3, 4, 10) * 0.01, 2)
        t = t[:7] if subject == 3 else t
        dose = round(4 + subject / 10, 1)
        conc = dose * ka / v / (ka - ke) * (np.exp(-ke * t) - np.exp(-ka * t)) + 0.05 * rng.standard_normal(len(t))
        for name, values in {"Subject": subject + 1, "Wt": 70 + subject, "Dose": dose, "Time": t, "conc": conc}.items():
            rows[name].append(np.broadcast_to(np.round(values, 3), t.shape))
    return table(tmp_path_factory.mktemp("lab") / "doses.csv", {k: np.concatenate(v) for k, v in rows.items()}), true


def test_a_trajectory_is_a_chunk_and_a_shorter_one_lacks_its_end(sampled):
    chunks = ea.read_measurements(sampled[0], Tablet(), **READ, length=2430)
    assert len(chunks) == 8 and chunks.y.shape[1] == 2430
    assert chunks.mask.sum((1, 2)).tolist() == [11, 11, 11, 7, 11, 11, 11, 11] and chunks.mask[:, 0].all()
    assert np.isfinite(chunks.u).all() and np.unique(chunks.u[3]) == pytest.approx([4.3])
    seen = np.flatnonzero(chunks.mask[3, :, 0])
    assert len(seen) == 7 and seen[-1] < 530, "rows are at their times"


def test_rows_beyond_the_chunks_end_are_told(sampled, caplog):
    chunks = ea.read_measurements(sampled[0], Tablet(), **READ, length=1001)
    assert chunks.mask.sum((1, 2)).tolist() == [9, 9, 9, 7, 9, 9, 9, 9]
    assert "14 of 84 rows lie beyond the 1001 points of a chunk" in caplog.text


def test_constants_of_each_are_found_by_steps_over_several_points(sampled):
    """And the same as by a step for each point of the grid."""
    path, true = sampled
    chunks = ea.read_measurements(path, Tablet(), **READ, length=2430)
    prior = {"ka": (0.3, 5.0), "ke": (0.03, 0.3), "V": (0.2, 1.0)}
    fit = {"observed_s": float(chunks.t[2425]), "prior": prior, "noise": 0.05, "starts": 8, "tries": 1}
    model = ea.least_squares(Tablet(), chunks, **fit, solver={"method": "rk4", "points_per_step": 8})
    forecast = model.forecast(chunks.seen[:, : model.observed], chunks.t, u=chunks.u)
    for k, name in enumerate(("ka", "ke", "V")):
        pull = (forecast.z_e[name] - true[:, k]) / forecast.z_e_std[name]
        assert np.abs(pull).max() < 4 and np.abs(forecast.z_e[name] / true[:, k] - 1).max() < 0.2
    alike = {name: getattr(chunks, name)[:1] for name in ("u", "mask", "id")}
    one = ea.Trajectories(chunks.t, chunks.y[:1], chunks.z_e[:1], **alike)
    each = ea.least_squares(Tablet(), one, **fit, solver={"method": "rk4"})
    again = each.forecast(one.seen[:, : each.observed], one.t, u=one.u)
    assert again.z_e["ka"] == pytest.approx(forecast.z_e["ka"][:1], rel=1e-3)


def settings(path, **given):
    return MeasurementSettings(**READ | {"paths": str(path), "length": 2430, "min_chunks": 1} | given)


def test_a_forecast_observes_the_first_rows(sampled):
    t = 0.01 * np.arange(2430)
    windows = latest_windows([str(sampled[0])], settings(sampled[0]), NAMES, t, 703)
    assert windows.y.shape == (8, 703, 1) and windows.start_s.tolist() == [0.0] * 8 and not windows.left_out
    assert np.isfinite(windows.y).sum((1, 2)).min() >= 7


def test_what_cannot_be_whole_is_refused(sampled, tmp_path):
    path = sampled[0]
    for given, told in (
        ({"split": {"by": "time"}}, r"split\.by: time divides trajectories"),
        ({"horizons_s": [30.0]}, "horizons_s.*no chunk is longer than a trajectory"),
        ({"uneven": "mask", "step_s": None}, "off a grid"),
    ):
        keys = READ | {"paths": str(path), "length": 2430} | given
        with pytest.raises(InputError, match=told):
            measure(MeasurementSettings.from_mapping(keys), NAMES)
    lines = path.read_text().splitlines()
    two = tmp_path / "two.csv"
    two.write_text("\n".join(lines[:23]) + "\n")
    with pytest.raises(InputError, match="whole: 2 trajectories are as many chunks"):
        ea.split_measurements(two, Tablet(), split={"by": "random"}, **READ, length=2430)


def test_a_first_row_without_a_value_is_where_time_begins(sampled, tmp_path):
    """As that of a dose: what was not measured then is an unknown of the fit, and no row is moved."""
    path, true = sampled
    lines = path.read_text().splitlines()
    first = [k for k, line in enumerate(lines) if k and float(line.split(",")[3]) == 0]
    assert len(first) == 8
    lines = [line.rpartition(",")[0] + "," if k in first else line for k, line in enumerate(lines)]
    blank = tmp_path / "blank.csv"
    blank.write_text("\n".join(lines) + "\n")
    chunks, before = (ea.read_measurements(file, Tablet(), **READ, length=2430) for file in (blank, path))
    assert not chunks.mask[:, 0].any() and (chunks.mask[:, 1:] == before.mask[:, 1:]).all()
    prior = {"ka": (0.3, 5.0), "ke": (0.03, 0.3), "V": (0.2, 1.0)}
    fit = {"observed_s": float(chunks.t[2425]), "prior": prior, "noise": 0.05, "starts": 8, "tries": 1}
    model = ea.least_squares(Tablet(), chunks, **fit, solver={"method": "rk4", "points_per_step": 8})
    found = model.forecast(chunks.seen[:, : model.observed], chunks.t, u=chunks.u)
    pull = (found.z_e["ke"] - true[:, 1]) / found.z_e_std["ke"]
    assert np.abs(pull).max() < 4 and np.abs(found.z_e["ke"] / true[:, 1] - 1).max() < 0.2


def test_inputs_that_end_before_the_chunk_are_told(tmp_path):
    t = np.array([0.0, 0.3, 0.5, 1.2, 2.0])
    rows = {"trial": np.repeat([0.0, 1.0, 2.0], 5), "t": np.tile(t, 3), "angle": np.cos(np.tile(t, 3))}
    path = table(tmp_path / "driven.csv", rows | {"drive": np.ones(15)})
    lab = {"columns": {"theta": "angle"}, "inputs": {"torque": "drive"}, "trajectory": "trial", "uneven": "own"}
    with pytest.raises(InputError, match=r"whole: known inputs of driven/0.* do not reach"):
        ea.read_measurements(path, ea.DrivenPendulum(), **lab, step_s=0.1, whole=True, length=31)


def test_inspection_proposes_it_with_the_covariate_and_the_steps(sampled, tmp_path, capsys, monkeypatch):
    own = "import torch\nfrom expertaug.systems.base import Parameter, System\n\n\n" + inspect.getsource(Tablet)
    (tmp_path / "tablet.py").write_text(own, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert main(["inspect-data", str(sampled[0]), "--system", "tablet:Tablet"]) == 0
    out = capsys.readouterr().out
    assert "ka is in 1/h: if the times are in h, read h where keys and figures say s" in out
    assert "dose [mg/kg], known: column 'Dose'" in out
    assert "the same in all rows of a trajectory, so no component: Wt;" in out
    experiment = yaml.safe_load(out)["experiments"]["measured"]
    files = experiment["data"]["files"]
    assert files["inputs"] == {"dose": "Dose"} and files["whole"] is True and "stride" not in files
    assert files["length"] == pytest.approx(2424, abs=4) and 5 < experiment["data"]["t1_s"] < 7.1
    assert 5 <= experiment["training"]["solver"]["points_per_step"] <= 15
    (tmp_path / "mine.yaml").write_text(out)
    assert main(["validate", "mine.yaml"]) == 0


def test_times_in_another_unit_than_the_systems_rates_are_told(sampled, caplog):
    hours = READ | {"time": {"name": "Time", "unit": "h"}, "step_s": 36.0}
    ea.read_measurements(sampled[0], Tablet(), **hours, length=2430)
    assert "times are converted to s, but the system has ka in 1/h" in caplog.text and "unit: s" in caplog.text
    caplog.clear()
    ea.read_measurements(sampled[0], Tablet(), **READ | {"time": {"name": "Time", "unit": "s"}}, length=2430)
    assert not caplog.records


def test_a_dose_that_stands_in_one_row_of_a_subject_is_no_concentration(tmp_path, capsys, monkeypatch):
    rows = [f"{subject},0,320,.,70\n" for subject in range(1, 5)]
    for subject in range(1, 5):
        rows += [f"{subject},{t:g},.,{10 * np.exp(-0.1 * t):.2f},70\n" for t in SAMPLED[1:]]
    rows.sort(key=lambda row: (row.split(",")[0], float(row.split(",")[1])))
    (tmp_path / "doses.csv").write_text("ID,TIME,AMT,DV,WT\n" + "".join(rows))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tablets.py").write_text(
        "import torch\nfrom expertaug.systems.base import Parameter, System\n\n\n" + inspect.getsource(Tablet)
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    assert main(["inspect-data", "doses.csv", "--system", "tablets:Tablet"]) == 0
    out = capsys.readouterr().out
    assert "conc (column 'DV')" in out and "no component: AMT, WT;" in out
    assert yaml.safe_load(out)["experiments"]["measured"]["data"]["files"]["whole"] is True, "from the dose on"


@pytest.mark.parametrize("uneven", ["mask", "interpolate"])
def test_of_rows_on_a_grid_too(tmp_path, uneven):
    """Also where rows are missing for longer than a chunk may otherwise span."""
    rows = []
    for trial, count in enumerate((40, 25, 33)):
        t = np.delete(np.arange(count), slice(8, 16) if trial == 2 else [])
        y = swing(0.5, points=count)[t]
        rows.append(np.column_stack((np.full(len(t), trial), STEP * t, y)))
    path = table(tmp_path / "a.csv", dict(zip(("trial", "t", "angle", "speed"), np.concatenate(rows).T, strict=True)))
    lab = {"columns": {"theta": "angle", "omega": "speed"}, "trajectory": "trial", "uneven": uneven}
    chunks = ea.read_measurements(path, ea.DampedPendulum(), **lab, whole=True, length=40)
    assert chunks.y.shape == (3, 40, 2) and chunks.t == pytest.approx(STEP * np.arange(40))
    measured = chunks.mask[..., 0].sum(1).tolist()
    assert measured == [40, 25, 25] and not chunks.mask[2, 8:16].any() and chunks.mask[2, 16:33].all()
    assert chunks.y[2, 20] == pytest.approx(swing(0.5, points=40)[20], abs=1e-5)


class Shaken(System):
    """A mass on a spring whose foundation moves as cos 2t, written with t itself."""

    state = (Parameter("x", "m"), Parameter("v", "m/s"))
    expert_parameters = (Parameter("k", "1/s²"),)

    def expert(self, t, y, z_e):
        x, v = y.unbind(-1)
        return torch.stack((v, torch.cos(2 * t) - z_e[..., 0] * x), dim=-1)


def test_chunks_that_begin_where_an_experts_time_does_not_are_told(tmp_path, caplog, capsys, monkeypatch):
    assert not systems.names(ea.DampedPendulum()).timed and systems.names(Shaken()).timed
    t = 0.1 * np.arange(300)
    rows = {"trial": np.repeat([0.0, 1.0, 2.0], 300), "t": np.tile(t, 3), "x": np.cos(np.tile(t, 3))}
    path = table(tmp_path / "shaken.csv", rows | {"v": -np.sin(rows["t"])})
    lab = {"columns": {"x": "x", "v": "v"}, "trajectory": "trial"}
    ea.read_measurements(path, Shaken(), **lab, length=150, stride=75)
    assert "depends on t" in caplog.text and "6 of 9 begin later in their trajectory: give whole: true" in caplog.text
    caplog.clear()
    ea.split_measurements(path, Shaken(), split={"by": "random"}, **lab, length=300, whole=True)
    ea.read_measurements(path, ea.DampedPendulum(), columns={"theta": "x", "omega": "v"}, trajectory="trial", length=50)
    assert not caplog.records
    own = "import torch\nfrom expertaug.systems.base import Parameter, System\n\n\n" + inspect.getsource(Shaken)
    (tmp_path / "shaken_here.py").write_text(own, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert main(["inspect-data", "shaken.csv", "--system", "shaken_here:Shaken"]) == 0
    assert "# the system's expert depends on t" in capsys.readouterr().out
