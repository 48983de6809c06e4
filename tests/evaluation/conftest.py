"""What the tests of figures share."""

import pytest

from expertaug import plotting


@pytest.fixture
def drawn(monkeypatch):
    """The figures that were saved."""
    kept = []
    save = plotting.save
    monkeypatch.setattr(plotting, "save", lambda figure, *args: (kept.append(figure), save(figure, *args)))
    return kept
