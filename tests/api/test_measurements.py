"""Tables of one's own become chunks whose values are those of the table, and sets that share no point."""

from __future__ import annotations

import numpy as np
import pytest

import expertaug as ea
from expertaug.api.measurements import read_measurements, split_measurements
from expertaug.errors import InputError

T = np.arange(24) * 0.1
READ = {"time": "s", "trajectory": "run", "columns": {"theta": "angle", "omega": "speed"}}


@pytest.fixture
def table(tmp_path):
    """Four swings of different sizes, as a file."""
    rows = [f"{run},{t:.1f},{(run + 1) * np.cos(t):.9f},{-(run + 1) * np.sin(t):.9f}" for run in range(4) for t in T]
    path = tmp_path / "swings.csv"
    path.write_text("\n".join(["run,s,angle,speed", *rows]) + "\n")
    return path


def test_chunks_have_the_values_of_the_rows_that_they_name(table):
    found = read_measurements(table, ea.DampedPendulum(), length=8, stride=8, **READ)
    assert len(found) == 4 * 3 and np.isnan(found.z_e).all() and found.mask.all()
    np.testing.assert_allclose(found.t, T[:8], atol=1e-12)
    sizes = np.repeat([1.0, 2.0, 3.0, 4.0], 3)[:, None]
    times = np.tile([0.0, 0.8, 1.6], 4)[:, None] + T[:8]
    np.testing.assert_allclose(found.y, np.stack((sizes * np.cos(times), -sizes * np.sin(times)), -1), atol=1e-6)
    assert len(set(found.trajectories)) == 4


def test_sets_share_no_trajectory_and_together_have_all(table):
    split = {"by": "random", "pieces": "trajectories", "train_share": 0.5, "validation_share": 0.25, "test_share": 0.25}
    sets = split_measurements([table], ea.DampedPendulum(), length=8, split=split, **READ)
    named = {name: set(data.trajectories) for name, data in sets.items()}
    assert sorted(named) == ["test", "train", "validation"] and sum(map(len, named.values())) == 4
    assert len(set.union(*named.values())) == 4


def test_a_component_without_a_column_is_masked_and_a_wrong_one_is_told(table):
    found = read_measurements(table, ea.DampedPendulum(), length=8, **READ | {"columns": {"theta": "angle"}})
    assert found.mask[..., 0].all() and not found.mask[..., 1].any()
    with pytest.raises(InputError, match="'omga'"):
        read_measurements(table, ea.DampedPendulum(), length=8, **READ | {"columns": {"omga": "speed"}})
