"""For all tests: one thread a process, as the command line has it; set before any numerical library is loaded.

This folder is on Python's path, so that tests of any room can name ``plain_parts:Class``.
"""

import os

import pytest

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list) -> None:
    """Tests of the small run are slow, and come first: while it goes on, the other process has all others to do."""
    for item in items:
        if "smoke_run" in item.fixturenames and item.get_closest_marker("outside") is None:
            item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: "smoke_run" not in item.fixturenames)
