"""Simulated sets: their random numbers, their noise, and what is said of one that fails."""

from __future__ import annotations

import zlib

import numpy as np
import pytest
import torch

from expertaug.errors import SolveError
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.settings import PendulumSettings, SimulateJob
from expertaug.systems.simulate import sample, simulate, trajectories
from expertaug.trajectories import Trajectories
from simulated_pendulums import pendulum_data


def test_every_seed_and_every_name_has_numbers_of_its_own():
    """Those of seed 0 are the name's alone, as ever."""
    ranges, t = {"omega0": (0.0, 1.0)}, np.arange(2) * 0.1
    system = DampedPendulum()
    drawn = {
        (seed, name): trajectories(system, ranges, {"alpha": (0.0, 0.0)}, n=20, t=t, seed=seed, name=name).z_e[:, 0]
        for seed in (0, 1, 2, 7, 2**31 - 1)
        for name in ("train", "validation")
    }
    values = np.stack(list(drawn.values()))
    assert len(np.unique(values)) == values.size
    assert np.abs(np.corrcoef(values) - np.eye(len(values))).max() < 0.75
    old = torch.Generator().manual_seed(zlib.crc32(b"train"))
    np.testing.assert_array_equal(
        drawn[0, "train"], torch.rand(20, 1, dtype=torch.float64, generator=old)[:, 0].float().numpy()
    )


def test_simulation_is_reproducible_and_sets_are_independent(tmp_path):
    data = pendulum_data(noise=0.01)
    data = data.model_copy(update={"sets": dict.fromkeys(("train", "test"), data.sets["train"])})
    job = SimulateJob(system=PendulumSettings(), data=data)
    for name, folder in (("train", "a"), ("train", "b"), ("test", "a")):
        simulate(name, tmp_path / folder / f"{name}.npz", job)
    assert (tmp_path / "a/train.npz").read_bytes() == (tmp_path / "b/train.npz").read_bytes()
    first, other = (Trajectories.load(tmp_path / f"a/{n}.npz") for n in ("train", "test"))
    assert not np.array_equal(first.z_e, other.z_e)


def test_noise_is_on_every_point_including_the_first():
    clean, noisy = (sample(DampedPendulum(), pendulum_data(200, s), "train") for s in (0.0, 0.01))
    assert np.std((noisy.y - clean.y)[:, 0]) == pytest.approx(0.01, rel=0.15)
    assert np.std((noisy.y - clean.y)[:, -1]) == pytest.approx(0.01, rel=0.15)


def test_a_simulation_that_fails_names_set_and_parameters():
    class Runaway(DampedPendulum):
        def truth(self, t, y, z_e, z_a):
            return torch.where(z_e > 2.5, y.square().sum(-1, keepdim=True) * 1e3 + 1e3, y)

    with pytest.raises(SolveError, match=r"Runaway, set train.*index \(\d+,\) with parameters \((2\.[5-9]|3)"):
        sample(Runaway(), pendulum_data(), "train")
