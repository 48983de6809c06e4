"""One store for all: making one costs seconds, an experiment of its own in it nothing."""

from __future__ import annotations

import json

import pytest
from logged import elsewhere, initial, settings

from expertaug.tracking.store import initialise


@pytest.fixture(autouse=True)
def _quickly(quick_stores):
    """Of every store that a test makes in its own process."""


@pytest.fixture(scope="session")
def store(tmp_path_factory):
    folder = tmp_path_factory.mktemp("store")
    found = settings(folder)
    initialise(initial(elsewhere(found, experiment="empty")), folder / "marker.json")
    assert json.loads((folder / "marker.json").read_text())["experiments"]["swing"]
    return found


@pytest.fixture
def tracking(store, request):
    return elsewhere(store, experiment=request.node.name)
