"""Where the workflow lies: in the checkout that this package is part of, or inside the installed package."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]
CHECKOUT, WITHIN = _PACKAGE.parents[1], _PACKAGE / "project"  # setup.py copies the workflow into a wheel as the latter


def folder() -> Path | None:
    """The folder that holds Snakefile, workflow/, config/ and profiles/; None where this package has neither."""
    return next((path for path in (CHECKOUT, WITHIN) if (path / "config" / "config.yaml").is_file()), None)
