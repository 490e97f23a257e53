"""One sentence for what is wrong in a system file, beginning with its place there."""

import difflib
import re
from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any, TypeVar

from pydantic import ValidationError

from exosight.errors import InputError
from exosight.system.description import TABLES, Description, JointTable, RadiusProfile, RelaxationTable
from exosight.system.units import si_unit
from exosight.validation import fault_sentence

Made = TypeVar("Made")

_PLACE = re.compile(r"\w+(\.\w+)*: ")

_WORDS = (
    ("Field required", "expected a value, got none"),
    ("Input should be", "expected"),
    ("Tuple should have", "expected"),
    ("Dictionary should have", "expected"),
    ("String should have", "expected"),
    ("greater than or equal to", "at least"),
    ("less than or equal to", "at most"),
    ("greater than", "more than"),
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

_UNKNOWN = ("unexpected_keyword_argument", "extra_forbidden")
_TAGS = re.compile(r"\.\[\w+\]| after validation, not \d+")
"""Of places: whether a key is meant, or which of several kinds of value."""


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
    """The first fault that pydantic found, in words for a file's author, on one line.

    An entry that is not known comes first: where one is misspelt, another one is missing.
    """
    faults = error.errors(include_url=False)
    fault = next((each for each in faults if each["type"] in _UNKNOWN), faults[0])
    place = tuple(str(step) for step in fault["loc"])
    if fault["type"] in _UNKNOWN:
        text = _unknown_entry(place)
    elif fault["type"] == "missing" and place[0] in TABLES and len(place) == 1:
        text = f"{place[0]}: expected at least one table [{place[0]}.NAME], got none"
    else:
        text = fault_sentence(_with_unit(fault))
        for theirs, ours in _WORDS:
            text = text.replace(theirs, ours)
    return _TAGS.sub("", text)


def _with_unit(fault: Mapping[str, Any]) -> Mapping[str, Any]:
    """The fault with the SI unit behind the limit that a quantity passes."""
    limited = {"greater_than", "greater_than_equal", "less_than_equal"}
    unit = si_unit(fault["input"]) if fault["type"] in limited else ""
    return {**fault, "msg": f"{fault['msg']} {unit}"} if unit else fault


def _unknown_entry(place: tuple[str, ...]) -> str:
    """The sentence for an entry that its table does not have, with the one that may be meant."""
    *outside, name = place
    if not outside:
        table: type = Description
    elif outside[-1] == "joint":
        table = JointTable
    elif outside[-2:-1] == ["relaxation"]:
        table = RelaxationTable
    elif outside[-1] == "[table]":
        table = RadiusProfile
    else:
        table = TABLES[outside[0]]
    known = [field.name for field in fields(table)]
    close = difflib.get_close_matches(name, known, 1)
    hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(known)}"
    return f"{'.'.join(place)[:200]}: there is no such entry; {hint}"
