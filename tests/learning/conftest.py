"""What the tests of learning share: a tiny pendulum experiment."""

from tiny import data, settings  # noqa: F401
