"""The default configuration that comes with the project, changed as a test wants it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest
import yaml

from expertaug.config import load as config
from expertaug.config.models import Configuration
from expertaug.config.yaml_file import Located
from expertaug.errors import InputError, lines
from expertaug.stages import STAGES

ROOT = Path(__file__).parents[1]


@cache
def _read() -> Located:
    return config.load([ROOT / "config" / "config.yaml"])


def default() -> Located:
    """What its files say, as one mapping."""
    return config.merge(_read(), {})


def alone(experiment: str) -> Located:
    """The same with one experiment, from which no other inherits what a test changes."""
    found = default()
    return config.merge(
        {k: v for k, v in found.items() if k != "experiments"},
        {"run": [experiment], "experiments": {experiment: found["experiments"][experiment]}},
    )


def valid(base: dict, text: str = "{}") -> Configuration:
    """Checked and completed, with a change."""
    return config.validate(config.merge(base, yaml.safe_load(text)), STAGES)


def refused(base: dict, text: str) -> str:
    """The one line that a change is answered with."""
    with pytest.raises(InputError) as caught:
        valid(base, text)
    message = str(caught.value)
    assert "\n" not in message
    return message


PENDULUM = "experiments: {{pendulum: {{{0}}}}}"  # a block of the pendulum's


def refusals(base: dict, text: str) -> list[str]:
    """Every line that a change is answered with."""
    with pytest.raises(InputError) as caught:
        config.validate(config.merge(base, yaml.safe_load(text)))
    return lines(caught.value)
