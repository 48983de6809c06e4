"""What the tests of the configuration share."""

from __future__ import annotations

import pytest

from shipped import default


@pytest.fixture(scope="module")
def base() -> dict:
    return default()
