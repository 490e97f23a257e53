"""The exceptions exosight raises on purpose.

ExosightError
├── InputError         an argument, option or configuration value outside its range
├── DataError          a file that is missing, truncated, damaged or of another kind
└── ConvergenceError   a solve that found no stable equilibrium

The command line turns each of them into one sentence on stderr and exit code 2.
"""

import unicodedata

_LONGEST = 1500
"""Characters of a message, whatever it quotes."""


def printable(text: str) -> str:
    """Text of unknown origin as a terminal may show it: only visible characters and spaces stay."""
    return "".join(
        each if each.isprintable() or unicodedata.category(each) == "Zs" else ascii(each)[1:-1]
        for each in text
    )


class ExosightError(Exception):
    """Base of everything exosight raises on purpose; its message is one printable line of bounded length."""

    def __init__(self, message: object = "") -> None:
        text = printable(" ".join(str(message).split()))
        super().__init__(text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…")


class InputError(ExosightError, ValueError):
    """An argument outside its range: the message says what, expected, got and remedy."""


class DataError(ExosightError, OSError):
    """A file or folder that cannot be used: the message names it and the remedy."""


class ConvergenceError(ExosightError, ArithmeticError):
    """No stable equilibrium was found where one was asked for."""
