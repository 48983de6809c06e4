"""Fixtures that several of these tests take."""

import pytest
from logger_tables import inspected  # noqa: F401

from expertaug.measurements.inspect import Inspection


@pytest.fixture(autouse=True)
def _without_pictures(request, monkeypatch):
    """Pictures are drawn in the tests of the module that draws them alone: each takes a quarter of a second."""
    if request.path.name != "test_inspect.py":
        monkeypatch.setattr(Inspection, "draw", lambda self, output: None)
