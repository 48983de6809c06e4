"""What model files say of the models that tests make by hand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from expertaug.models.card import ModelCard


def card(said: Mapping[str, Any], **more: Any) -> ModelCard:
    """A card of what matters to a test; the rest is a pendulum's."""
    beside = {"kind": "hybrid", "system": {"name": "pendulum"}, "seeds": [0]}
    return ModelCard.of(**beside | dict(said) | more)
