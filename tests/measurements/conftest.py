"""A fixture that several of these tests take."""

from logger_tables import inspected  # noqa: F401
