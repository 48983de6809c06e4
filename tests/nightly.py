"""Cases of one kind of which the first are tried with every change, and the rest at night (marker `slow`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterable


def others_slow(cases: Iterable[Any], quick: int = 1) -> list[Any]:
    """These arguments of `parametrize`, one or a tuple each, with all but the first `quick` marked `slow`."""
    return [
        case if k < quick else pytest.param(*(case if isinstance(case, tuple) else [case]), marks=pytest.mark.slow)
        for k, case in enumerate(cases)
    ]
