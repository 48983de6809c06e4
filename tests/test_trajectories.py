"""Sets of trajectories: the identities that their samples may carry."""

import numpy as np
import pytest

from expertaug.errors import InputError
from expertaug.trajectories import Trajectories

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
