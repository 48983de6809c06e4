"""The one exception for bad input: its message is the single line that a user sees."""

from __future__ import annotations

from collections.abc import Sequence

LONGEST = 300  # characters of each part of a message


class InputError(Exception):
    """Bad input: a file, a value or a configuration key that cannot be used.

    The message is one line: which file or key, what was found, what would be right.  The command line prints it
    without a traceback and exits with status 2.

    What it quotes may come from a hostile file: characters that a terminal would obey are escaped, and long texts cut.

    Attributes:
        where: the file or key, as a text.
        found, remedy: what was found, and what would be right.
    """

    def __init__(self, where: object, found: str, remedy: str = "") -> None:
        self.where, self.found, self.remedy = str(where), found, remedy
        parts = (str(where), found, remedy) if remedy else (str(where), found)
        where, found, *rest = (_one_line(part) for part in parts)
        super().__init__("; ".join((f"{where}: {found}", *rest)))


class InputErrors(InputError):
    """Several of them at once; the message is the first one's.

    Attributes:
        errors: all of them, in order.
    """

    def __init__(self, errors: Sequence[InputError]) -> None:
        self.errors = list(errors)
        self.where, self.found, self.remedy = (getattr(self.errors[0], name) for name in ("where", "found", "remedy"))
        Exception.__init__(self, str(self.errors[0]))


def lines(error: InputError) -> list[str]:
    """What a user sees: a line for each error."""
    return [str(single) for single in (error.errors if isinstance(error, InputErrors) else [error])]


def printable(text: str) -> str:
    """The text with what a terminal, YAML or Markdown would obey escaped: a name may hold a line break."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def _one_line(text: str) -> str:
    text = printable(" ".join(text.split())[: 10 * LONGEST])
    return text if len(text) <= LONGEST else f"{text[: LONGEST // 2]} … {text[-LONGEST // 2 :]}"


class SolveError(RuntimeError):
    """A solve produced non-finite values; the message names the system, the seed and the parameters."""
