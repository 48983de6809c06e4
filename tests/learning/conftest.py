"""What the tests of learning share: a tiny pendulum experiment."""

from tiny import data, killed, settings  # noqa: F401
