"""Sets of trajectories: the identities that their samples may carry, what was measured of them, what is known."""

import numpy as np
import pytest

from expertaug.errors import InputError
from expertaug.trajectories import SetFolder, Trajectories, points_until

NAMES = np.array(["r0/0", "r0/80", "r10/4"])


def made(identity):
    y = np.arange(3 * 5 * 2, dtype=float).reshape(3, 5, 2)
    return Trajectories(np.arange(5) / 10, y, y[:, 0], id=identity)


def test_identities_go_wherever_their_samples_go(tmp_path):
    made(NAMES).save(tmp_path / "set.npz")
    found = Trajectories.load(tmp_path / "set.npz")
    for part, names in ((found, NAMES), (found.subset([2, 0]), NAMES[[2, 0]]), (found.window(1, 4), NAMES)):
        assert part.id.tolist() == names.tolist()
    assert found.subset(np.array([False, True, False])).id.tolist() == ["r0/80"]


def test_sets_without_identities_as_older_files_are(tmp_path):
    made(None).save(tmp_path / "set.npz")
    assert "id" not in np.load(tmp_path / "set.npz").files
    found = Trajectories.load(tmp_path / "set.npz")
    assert found.id is None and found.subset([0]).id is None and found.window(0, 2).id is None


@pytest.mark.parametrize("identity", [NAMES[:2], NAMES[:, None], np.arange(3), np.array("r0/0")])
def test_identities_are_one_text_a_sample(identity):
    with pytest.raises(InputError, match=r"id has shape .* for 3 samples; id is \(N,\), texts"):
        made(identity)


def test_what_was_not_measured_is_masked_wherever_its_samples_go(tmp_path):
    y = np.arange(3 * 5 * 2, dtype=float).reshape(3, 5, 2)
    mask = np.ones(y.shape, dtype=bool)
    mask[1, 2:4, 1] = False
    y[~mask] = np.nan
    Trajectories(np.arange(5) / 10, y, y[:, 0], mask=mask, noise=[0.1, 0.2]).save(tmp_path / "set.npz")
    found = Trajectories.load(tmp_path / "set.npz")
    assert np.array_equal(found.mask, mask) and (found.y[~mask] == 0).all() and found.noise.tolist() == [0.1, 0.2]
    assert np.array_equal(np.isnan(found.seen), ~mask)
    assert np.array_equal(found.subset([1]).mask, mask[[1]]) and found.subset([0, 2]).mask.all()
    assert np.array_equal(found.window(3, 5).mask, mask[:, 3:5]) and found.window(0, 2).mask.all()


def test_parameters_may_be_unknown_but_never_infinite():
    y = np.zeros((3, 5, 2))
    assert np.isnan(Trajectories(np.arange(5), y, np.full((3, 1), np.nan)).z_e).all()
    with pytest.raises(InputError, match="z_e is not finite"):
        Trajectories(np.arange(5), y, np.full((3, 1), np.inf))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"mask": np.ones((3, 5), dtype=bool)}, "mask has shape"),
        ({"mask": np.ones((3, 5, 2))}, "mask has shape .* and type float64"),
        ({"noise": [0.1]}, "noise has shape"),
        ({"noise": [0.1, np.nan]}, "one number of 0 or more a component"),
    ],
)
def test_masks_and_noise_fit_the_states(given, message):
    with pytest.raises(InputError, match=message):
        Trajectories(np.arange(5), np.zeros((3, 5, 2)), np.zeros((3, 1)), **given)


@pytest.mark.parametrize("offset", [0.0, 1e-7, -1e-7, 4e-6])
def test_a_time_that_went_through_single_precision_is_not_lost(offset):
    t = (np.arange(100) * 0.1).astype(np.float32).astype(float) + offset
    for k in range(2, 100):
        assert points_until(t, round(0.1 * k, 1)) == k + 1


def test_a_time_well_beyond_the_end_is_not_counted():
    assert points_until(np.arange(100) * 0.1 + 0.002, 2.4) == 24


def test_sets_of_a_folder_are_read_when_they_are_asked_for(tmp_path):
    """None is kept: two of a set are two values."""
    sets = SetFolder(tmp_path)
    for name in ("train", "test"):
        Trajectories(np.arange(3.0), np.zeros((2, 3, 1)), np.zeros((2, 1))).save(tmp_path / f"{name}.npz")
    assert sorted(sets) == ["test", "train"] and len(sets) == 2 and "iid" not in sets
    assert len(sets["train"]) == 2 and sets["train"] is not sets["train"]
    with pytest.raises(InputError, match=r"iid\.npz: no such file"):
        sets["iid"]
