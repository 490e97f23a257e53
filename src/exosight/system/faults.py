"""One sentence for what is wrong in a system file, beginning with its place there."""

import re
from collections.abc import Callable
from typing import TypeVar

from pydantic import ValidationError

from exosight.errors import InputError
from exosight.validation import first_fault

Made = TypeVar("Made")

_PLACE = re.compile(r"\w+(\.\w+)*: ")

_WORDS = (
    ("Unexpected keyword argument", "there is no such entry"),
    ("Extra inputs are not permitted", "there is no such entry"),
    ("Field required", "expected a value, got none"),
    ("Input should be", "expected"),
    ("Tuple should have", "expected"),
    ("Dictionary should have", "expected"),
    ("String should have", "expected"),
    ("a valid dictionary", "a table"),
    ("a dictionary or an instance of", "a table for"),
    ("a valid tuple", "a list"),
    (
        "String should match pattern '^[A-Za-z0-9_.]+$'",
        "expected an entry of this file, such as rods.sleeve.young",
    ),
    (
        "String should match pattern '^[A-Za-z][A-Za-z_0-9]{0,31}$'",
        "expected a name of at most 32 letters, digits and underscores, a letter first",
    ),
)
"""pydantic's words → ours."""


def at_place(place: str, make: Callable[..., Made], *arguments: object) -> Made:
    """What `make` returns at the arguments.

    Raises an InputError for any ValueError of it; a place at the beginning of its message is within `place`.
    """
    try:
        return make(*arguments)
    except ValidationError as error:
        message = sentence(error)
    except ValueError as error:  # InputError is one
        message = str(error)
    raise InputError(f"{place}{'.' if _PLACE.match(message) else ': '}{message}") from None


def sentence(error: ValidationError) -> str:
    """The first fault that pydantic found, in words for a file's author, on one line."""
    text = " ".join(first_fault(error).split())
    for theirs, ours in _WORDS:
        text = text.replace(theirs, ours)
    return printable(text.replace(".[key]", ""))


def printable(text: str) -> str:
    """Text of a file as a terminal may show it: control characters are written out."""
    return "".join(each if each.isprintable() else ascii(each)[1:-1] for each in text)
