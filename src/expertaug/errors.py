"""The one exception for bad input: its message is the single line that a user sees."""

from __future__ import annotations


class InputError(Exception):
    """Bad input: a file, a value or a configuration key that cannot be used.

    The message is one line: which file or key, what was found, what would be right.  The command line prints it
    without a traceback and exits with status 2.
    """

    def __init__(self, where: object, found: str, remedy: str = "") -> None:
        text = f"{where}: {found}"
        super().__init__(" ".join((f"{text}; {remedy}" if remedy else text).split()))


class SolveError(RuntimeError):
    """A solve produced non-finite values; the message names the system, the seed and the parameters."""
