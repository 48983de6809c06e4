"""The figure of the splits, and what does not fit it."""

from __future__ import annotations

import numpy as np
import pytest
from angle_files import write_angles
from pendulum_motion import truth

from expertaug.errors import InputError
from expertaug.measurements.splitting import SPLITS
from expertaug.trajectories import Trajectories
from expertaug_recordings.chunks import split_chunks
from expertaug_recordings.reports.splits import run_stage as plot_splits
from expertaug_recordings.settings import SplitChunksJob


@pytest.mark.slow
def test_figure(tmp_path):
    angles = [write_angles(tmp_path / f"r{k}", y) for k, y in enumerate(truth()[:, :8000])]
    split_chunks(angles, tmp_path / "data", SplitChunksJob(min_chunks=1, guard_s=0.0))
    plot_splits(tmp_path / "data", [tmp_path / "splits.png", tmp_path / "splits.pdf"])
    assert (tmp_path / "splits.png").stat().st_size > 20_000 and (tmp_path / "splits.pdf").stat().st_size > 5_000
    chunks, figure = tmp_path / "data" / "chunks.csv", tmp_path / "again.png"
    lines = chunks.read_text().splitlines(keepends=True)
    for text, message in (
        ("".join(lines[:2]), r"energies of 1 train chunks, train\.npz has"),
        ("".join(line.rpartition(",")[0] + "\n" for line in lines), "not a table of chunks"),
        ("".join([*lines[:5], lines[5].rpartition(",")[0], ",much\n", *lines[6:]]), "not a table of chunks"),
        ("", "not a table of chunks"),
    ):
        chunks.write_text(text)
        with pytest.raises(InputError, match=message):
            plot_splits(tmp_path / "data", figure)
    chunks.unlink()
    with pytest.raises(InputError, match="no such file"):
        plot_splits(tmp_path / "data", figure)
    Trajectories(np.arange(3) / 10, np.zeros((4, 3, 3)), np.zeros((4, 2))).save(tmp_path / "data" / "test.npz")
    with pytest.raises(InputError, match=r"test\.npz: y has shape \(4, 3, 3\); chunks are \(N, T, 4\)"):
        plot_splits(tmp_path / "data", figure)
    assert not figure.exists()


def test_energies_that_are_not_those_of_the_sets_are_refused_before_anything_is_drawn(tmp_path):
    for name in SPLITS:
        Trajectories(np.arange(3) / 10, np.zeros((2, 3, 4)), np.zeros((2, 2))).save(tmp_path / f"{name}.npz")
    (tmp_path / "chunks.csv").write_text("split,energy\ntrain,1\ntrain,2\nvalidation,3\n")
    with pytest.raises(
        InputError, match=r"energies of 1 validation chunks, validation\.npz has 2; run split_chunks again"
    ):
        plot_splits(tmp_path, tmp_path / "splits.png")
    assert not (tmp_path / "splits.png").exists()
