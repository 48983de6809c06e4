"""What the tests of inference share: a tiny pendulum experiment."""

from tiny import data, killed, settings  # noqa: F401
