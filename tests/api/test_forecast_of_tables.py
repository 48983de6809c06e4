"""expertaug forecast takes the table that the training took: its columns, units, gaps and trajectories."""

from __future__ import annotations

import io

import numpy as np
import pandas as pd
import pytest
import yaml
from small_pendulum import ENCODER, INTERACTION, OPTIONS

import expertaug as ea
from expertaug.cli import main

COLUMNS = {"theta": {"name": "Winkel", "unit": "deg"}}
READ = {
    "time": {"name": "ms", "unit": "ms"},
    "trajectory": "Versuch",
    "columns": COLUMNS,
    "separator": ";",
    "decimal": ",",
}


def table(path, runs=6, points=60, noise=0.005, first_s=0.0, gaps=()):
    """Swings without a speed, in a table with German numbers."""
    sets = ea.simulate(
        ea.DampedPendulum(), {"omega0": (1.5, 3.1)}, {"alpha": (0.1, 0.3)}, n=runs, t=np.arange(points) * 0.1
    )
    y = sets.y[..., 0] + noise * np.random.default_rng(0).standard_normal(sets.y.shape[:2])
    lines = ["Versuch;ms;Winkel"]
    for k, one in enumerate(y):
        for place, angle in enumerate(np.rad2deg(one)):
            cell = "" if place in gaps else f"{angle:.4f}"
            lines.append(f"run {k};{100 * place + 1000 * first_s:.1f};{cell}".replace(".", ","))
    path.write_text("\n".join(lines) + "\n")
    return sets, path


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A folder as a run leaves it: a model, and its data beside it."""
    folder = tmp_path_factory.mktemp("run")
    _, path = table(folder / "swings.csv")
    files = {**READ, "paths": str(path), "length": 21, "stride": 5, "evaluation_stride": 10, "min_chunks": 1}
    files |= {"split": {"by": "random", "pieces": "trajectories"}}
    settings = yaml.safe_dump({"system": {"name": "pendulum"}, "files": files})
    (folder / "job.yaml").write_text(settings)
    job = ["--settings", str(folder / "job.yaml")]
    assert main(["cut-measurements", *job, "--output", str(folder / "data"), str(path)]) == 0
    sets = [ea.Trajectories.load(folder / "data" / f"{name}.npz") for name in ("train", "validation")]
    recipe = ea.HybridModel(ea.DampedPendulum(), encoder=ENCODER, interaction=INTERACTION)
    model = ea.fit(recipe, *sets, observed_s=1.0, seeds=[0, 1], start={"omega": (-4.0, 4.0)}, **OPTIONS)
    model.save(folder / "aphynity" / "seeds_0_1" / "model.safetensors")
    return folder, model


def forecast(run, path, capsys, *options, status=0):
    model = run[0] / "aphynity" / "seeds_0_1" / "model.safetensors"
    assert main(["forecast", "--model", str(model), str(path), *options]) == status
    told = capsys.readouterr()
    return (pd.read_csv(io.StringIO(told.out)), told.err) if status == 0 else (None, told.err)


def test_the_training_table_itself(run, capsys):
    found, told = forecast(run, run[0] / "swings.csv", capsys)
    assert list(found["sample"].unique()) == [f"swings/run {k}" for k in range(6)]
    one = found[(found["sample"] == "swings/run 2") & (found["seed"] == 0)]
    np.testing.assert_allclose(one["t [s]"], 4.9 + 0.1 * np.arange(21))
    lines = [line for line in told.splitlines() if line.startswith("swings/run")]
    assert len(lines) == 6 and "from 5.9 to 6.9 s, omega0 = " in lines[0]
    assert " ± " in lines[0] and "rad/s" in lines[0] and "trust it is unknown" in lines[0]
    assert {"theta [rad]", "theta std [rad]", "omega [rad/s]", "z_e omega0 [rad/s]"} <= set(found.columns)


def test_the_same_as_in_python(run, capsys, tmp_path):
    _, path = table(tmp_path / "new.csv", runs=2, points=11, first_s=3.0)
    found, _ = forecast(run, path, capsys)
    chunks = ea.read_measurements(path, ea.DampedPendulum(), length=11, **READ)
    expected = run[1].forecast(chunks.seen, run[1].t)
    one = found[(found["sample"] == "new/run 1") & (found["seed"] == 1)]
    np.testing.assert_allclose(one["theta [rad]"], expected.y[1, 1, :, 0], rtol=1e-6)
    np.testing.assert_allclose(one["t [s]"], 3.0 + 0.1 * np.arange(21))


def test_gaps_later_times_and_refined_estimates(run, capsys, tmp_path):
    _, path = table(tmp_path / "new.csv", runs=2, points=30, gaps=(21, 25))
    found, told = forecast(run, path, capsys, "--refine", "estimated", "--t-end", "3.0", "--seed", "0")
    assert found["t [s]"].max() == pytest.approx(1.9 + 3.0)
    assert found["z_e omega0 std [rad/s]"].notna().all() and "χ²" in told


def test_trajectories_that_are_too_short_are_named(run, capsys, tmp_path):
    _, path = table(tmp_path / "new.csv", runs=2, points=30)
    kept = [line for k, line in enumerate(path.read_text().splitlines()) if k <= 35]
    path.write_text("\n".join(kept) + "\n")
    found, told = forecast(run, path, capsys)
    assert set(found["sample"]) == {"new/run 0"} and "new/run 1: no window as the model observes it" in told
    path.write_text("\n".join(kept[:6]) + "\n")
    _, told = forecast(run, path, capsys, status=2)
    assert "no trajectory has a window as the model observes it; it needs 11 points 0.1 s apart" in told


def test_a_model_elsewhere_is_told_how_tables_are_read(run, capsys, tmp_path):
    run[1].save(tmp_path / "m.safetensors")
    command = ["forecast", "--model", str(tmp_path / "m.safetensors"), str(run[0] / "swings.csv")]
    assert main(command) == 2
    capsys.readouterr()
    config = {"experiments": {"a": {"data": {"files": yaml.safe_load((run[0] / "job.yaml").read_text())["files"]}}}}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(config))
    for given in (run[0] / "data" / "splits.json", tmp_path / "mine.yaml"):
        assert main([*command, "--measurements", str(given)]) == 0
        assert capsys.readouterr().out.startswith("seed,sample,t [s],theta [rad]")
    assert main([*command, "--measurements", str(tmp_path / "none.yaml")]) == 2
    assert "none.yaml" in capsys.readouterr().err


def test_a_table_of_windows_is_still_one(run, capsys, tmp_path):
    window = pd.DataFrame({"t": 0.1 * np.arange(11), "theta": np.cos(0.2 * np.arange(11)), "omega": 0.0})
    window.to_csv(tmp_path / "w.csv", index=False)
    found, _ = forecast(run, tmp_path / "w.csv", capsys)
    assert "theta std [rad]" not in found and set(found["sample"]) == {0}
