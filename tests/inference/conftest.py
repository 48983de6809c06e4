"""What the tests of inference share: a tiny pendulum experiment."""

from tiny import data, settings  # noqa: F401
