"""A configuration as the workflow uses it."""

from __future__ import annotations

from collections.abc import Mapping

from expertaug.config import grid
from expertaug.config.load import merge, validate


def completed(config: Mapping) -> dict:
    """A configuration, all files merged, checked and completed, with a method for each point of its grids.

    Raises:
        InputError: everything that is wrong.
    """
    return grid.expand(validate(config), lambda change: validate(merge(config, change)))
