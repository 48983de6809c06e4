"""What the tests of stages share: the files of a run of the shipped pendulum."""

from __future__ import annotations

import pytest

from expertaug.stages.files import Files
from shipped import alone, valid


@pytest.fixture(scope="module")
def files() -> Files:
    return Files(valid(alone("pendulum")))
