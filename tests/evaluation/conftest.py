"""What the tests of evaluation share: tiny and made-up runs, and the figures that are drawn of them."""

import pytest
from evaluated_pendulum import folder  # noqa: F401
from fake_windows import files  # noqa: F401
from fitted_pendulum import fitted  # noqa: F401

from expertaug import plotting
from tiny import data, settings  # noqa: F401


@pytest.fixture
def drawn(monkeypatch):
    """The figures that were saved."""
    kept = []
    save = plotting.save
    monkeypatch.setattr(plotting, "save", lambda figure, *args: (kept.append(figure), save(figure, *args)))
    return kept
