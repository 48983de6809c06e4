"""Recordings brought as tables of measurements: the same chunks, and from them the same numbers to the last digit."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from expertaug.config import jobs, stage_settings
from expertaug.config import load as config
from expertaug.measurements.horizons import cut_measured_horizon
from expertaug.measurements.names import Names
from expertaug.measurements.settings import MeasurementSettings
from expertaug.measurements.stage import cut_measurements
from expertaug.settings import read
from expertaug.systems.double_pendulum import Constants, energy
from expertaug.trajectories import Trajectories
from expertaug_recordings.chunks import cut_horizon, split_chunks
from expertaug_recordings.rendering.motion import simulate
from expertaug_recordings.settings import CutHorizonJob, SplitChunksJob
from typed_jobs import evaluate, train

CONFIG = Path(__file__).parents[2] / "config"
STATE = ["theta1", "theta2", "omega1", "omega2"]
SPEEDS = dict.fromkeys(STATE[2:], "rad/s")
RATE = 200.0
CONSTANTS, FRICTION = Constants(B1=0.103, G1=69.4, B2=1.366, G2=93.6), (0.03, 0.12)
CHUNKS = {"length": 20, "min_chunks": 2, "stride": 5, "evaluation_stride": 20}
SHARES = {"train_share": 0.4, "validation_share": 0.3, "test_share": 0.3, "guard_s": 0.06}
# What config/experiments/double_pendulum.yaml says of recordings, said of tables.
FILES = {
    **CHUNKS,
    "paths": "given to the stage",
    "time": "t",
    "columns": {name: name for name in STATE},
    "angles": STATE[:2],
    "z_e": {name: {"start": name} for name in SPEEDS},
    "step_s": 0.01,
    "longest_gap": 0,
    "min_seen": 1.0,
}
SPLITS = {"energy": {"by": "quantity", "quantity": "level"}, "time": {"by": "time", "reverse": True}}
NAMES = Names(dict(zip(STATE, ["rad", "rad", "rad/s", "rad/s"], strict=True)), SPEEDS)
HORIZON_S = 0.4


def files(by: str) -> dict:
    return {**FILES, "split": {**SPLITS[by], **SHARES}}


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> dict[str, dict[str, Path]]:
    """By each split, chunks of two recordings of 5 s as recordings and as tables.  Their first frames and some others
    are not usable: those rows of the tables are empty but for the time."""
    root = tmp_path_factory.mktemp("both")
    t, angles = np.arange(1000) / RATE, []
    for k, launch in enumerate(([2.2, 1.0, -6.0, -12.0], [1.8, 2.0, -5.0, -9.0])):
        y = simulate(np.array([launch]), t, CONSTANTS, FRICTION)[0]
        table = pd.DataFrame(y, columns=STATE).assign(frame=np.arange(len(t)), t=t, quality=1.0)
        table.loc[300 + 40 * k : 310 + 40 * k, "quality"] = 0.0
        table.loc[: 7 + k, "quality"] = 0.5
        angles.append(root / f"r{k}" / "angles.csv")
        angles[-1].parent.mkdir()
        table.to_csv(angles[-1], index=False)
    for by in SPLITS:
        split_chunks(angles, root / by / "recordings", SplitChunksJob(**CHUNKS, rate_hz=100.0, by=by))
    constants = json.loads((root / "energy" / "recordings" / "splits.json").read_text())["energy_constants"]
    tables = []
    for path in angles:
        table = pd.read_csv(path)
        table["level"] = energy(table[STATE].to_numpy(), Constants(**constants))
        table.loc[table["quality"] < 1, [*STATE, "level"]] = np.nan
        tables.append(root / f"{path.parent.name}.csv")
        table.to_csv(tables[-1], index=False)
    for by in SPLITS:
        cut_measurements(tables, root / by / "files", read(MeasurementSettings, files(by)), NAMES)
        for name in ("validation_400ms", "test_400ms"):
            split = {**CHUNKS, "rate_hz": 100.0, "by": by, "horizons_s": [HORIZON_S]}
            cut_horizon(angles, root / by / "recordings" / f"{name}.npz", CutHorizonJob(split=split, set=name))
            longer = read(MeasurementSettings, {**files(by), "horizons_s": [HORIZON_S]})
            cut_measured_horizon(tables, root / by / "files" / f"{name}.npz", longer, name, NAMES)
    return {by: {source: root / by / source for source in ("recordings", "files")} for by in SPLITS}


# Of the chunks' identities, as recordings were cut when they had a cutter of their own.
KEPT = {
    "energy": {
        "train": (136, "9cbbbcf1f0d872c1"),
        "validation": (23, "2c0681c75d4771f5"),
        "test": (26, "aa5c2ec414a9c2d6"),
        "validation_400ms": (8, "3f2e9f76da2752a2"),
        "test_400ms": (10, "5fd73bb92821c0dc"),
    },
    "time": {
        "train": (140, "e159e9b63c51b45f"),
        "validation": (22, "c0bed5181cad1179"),
        "test": (27, "6853255a1831d210"),
        "validation_400ms": (9, "7f4f32a3ad703d5c"),
        "test_400ms": (10, "e947715a184f748f"),
    },
}


@pytest.mark.parametrize("by", list(SPLITS))
def test_recordings_are_cut_as_they_ever_were(folders, by):
    for name, kept in KEPT[by].items():
        chunks = Trajectories.load(folders[by]["recordings"] / f"{name}.npz")
        assert (len(chunks), hashlib.sha256("\n".join(chunks.id).encode()).hexdigest()[:16]) == kept
        assert chunks.noise is None and chunks.mask is None


@pytest.mark.parametrize("by", list(SPLITS))
def test_the_chunks_are_the_same_bits(folders, by):
    for name in ("train", "validation", "test", "validation_400ms", "test_400ms"):
        one, other = (Trajectories.load(folder / f"{name}.npz") for folder in folders[by].values())
        assert len(one) >= 2 and other.mask is None
        for part in ("t", "y", "z_e"):
            np.testing.assert_array_equal(getattr(one, part), getattr(other, part), strict=True)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["aphynity_point_mass", "least_squares"])
def test_and_so_are_the_numbers(folders, tmp_path, method):
    shipped = config.load([CONFIG / "config.yaml", CONFIG / "smoke.yaml"])
    tables = []
    for source, folder in folders["energy"].items():
        over = {"system": {"expert": "point_mass"}, "methods": [method], "studies": {"during_training": None}}
        over |= {"augmented": [], "controls": [], "refined": [], "training": {"epochs": 1}}
        given = config.merge(shipped, {"run": ["double_pendulum"], "experiments": {"double_pendulum": over}})
        data = given["experiments"]["double_pendulum"]["data"]
        if source == "files":
            data.pop("split")
            data |= {"source": "files", "files": {**files("energy"), "paths": str(folder.parents[1] / "*.csv")}}
        else:
            data["split"]["horizons_s"] = []
        data["calibrate"] = False
        checked, out = config.validate(given), tmp_path / source
        out.mkdir()
        group = next(iter(jobs.seed_groups(checked, "double_pendulum")))
        model = out / "model.safetensors"
        train(folder, model, out / "work", stage_settings.train(checked, "double_pendulum", method, group), None)
        told = stage_settings.evaluate(checked, "double_pendulum", method, group)
        evaluate(model, folder, out / "metrics.csv", out / "forecasts.npz", told)
        table = pd.read_csv(out / "metrics.csv", dtype=str)
        tables.append(table[~table["metric"].isin(["wall_s", "estimate_ms"])])
    pd.testing.assert_frame_equal(*tables)
    assert len(tables[0]) > 20
