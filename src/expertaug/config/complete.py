"""A configuration as the workflow uses it."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from expertaug.config import grid
from expertaug.config.load import merge, validate


def completed(config: Mapping, stages: Collection[str] = ()) -> dict:
    """A configuration, all files merged, checked and completed, with a method for each point of its grids.

    Arguments:
        stages: names of the workflow's stages, which no experiment may have.

    Raises:
        InputError: everything that is wrong.
    """
    return grid.expand(validate(config, stages), lambda change: validate(merge(config, change)))
