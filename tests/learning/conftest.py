"""What the stages' tests share: a tiny pendulum experiment."""

import copy

import pytest
from tiny import DATA, SETTINGS

from expertaug.systems.simulate import simulate


@pytest.fixture
def settings():
    return copy.deepcopy(SETTINGS)


@pytest.fixture(scope="session")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pendulum")
    for name in DATA["sets"]:
        simulate(name, folder / f"{name}.npz", {"system": {"name": "pendulum"}, "data": DATA})
    return folder
