"""Where the captions of the report are."""

from __future__ import annotations

from pathlib import Path

CAPTIONS = Path(__file__).parents[2] / "workflow" / "report"
