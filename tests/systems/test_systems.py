"""Systems by their names, trajectories by their files, and what is said of a name or a value that is none."""

import numpy as np
import pytest

from expertaug import systems
from expertaug.errors import InputError
from expertaug.systems.settings import SYSTEMS, SimulatedSet
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories


def test_bad_input_is_named():
    with pytest.raises(InputError, match=r"system.name.*'nothing'"):
        systems.load({"name": "nothing"})
    with pytest.raises(InputError, match=r"system.colour.*unknown"):
        systems.load({"name": "double_pendulum", "colour": 1})
    with pytest.raises(InputError, match=r"constants.*calibrate"):
        systems.load({"name": "double_pendulum"})
    with pytest.raises(InputError, match="min must not exceed max"):
        SimulatedSet.from_mapping({"size": 50, "z_e": {"omega0": [3.0, 1.0]}})
    with pytest.raises(InputError, match="euler9"):
        Solver("euler9")


@pytest.mark.parametrize("name", ["pendulm", "adams", "base", "settings", "solvers", "simulate", ""])
def test_what_is_no_system_is_told_of_systems_alone(name):
    with pytest.raises(InputError) as refused:
        systems.load({"name": name})
    known = str(refused.value).rpartition("known: ")[2]
    assert known == f"{', '.join(SYSTEMS)}; or a dotted path, or module:Class"
    assert ("did you mean 'pendulum'?" in str(refused.value)) == (name == "pendulm")


def test_trajectories_check_and_round_trip(tmp_path):
    data = Trajectories(np.arange(4.0), np.ones((3, 4, 2)), np.ones((3, 1)))
    data.save(tmp_path / "x.npz")
    assert np.array_equal(Trajectories.load(tmp_path / "x.npz").window(1, 3).y, data.y[:, 1:3])
    with pytest.raises(InputError, match="not finite"):
        Trajectories(np.arange(4.0), np.full((3, 4, 2), np.nan), np.ones((3, 1)))
    with pytest.raises(InputError, match="strictly increasing"):
        Trajectories(np.zeros(4), np.ones((3, 4, 2)), np.ones((3, 1)))
    with pytest.raises(InputError, match="z_e"):
        Trajectories(np.arange(4.0), np.ones((3, 4, 2)), np.ones((2, 1)))
    (tmp_path / "y.npz").write_bytes(b"nonsense")
    with pytest.raises(InputError, match=r"y\.npz.*not a trajectory file"):
        Trajectories.load(tmp_path / "y.npz")
