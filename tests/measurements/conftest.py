"""A fixture that several of these tests take."""

from logged import inspected  # noqa: F401
