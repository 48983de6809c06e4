"""What the tests of figures share."""

import pytest

from expertaug.evaluation import style


@pytest.fixture
def drawn(monkeypatch):
    """The figures that were saved."""
    kept = []
    save = style.save
    monkeypatch.setattr(style, "save", lambda figure, outputs: (kept.append(figure), save(figure, outputs)))
    return kept
