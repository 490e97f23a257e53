"""What configurations, files and metadata are checked with."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Annotated, Any

from pydantic import ConfigDict, StringConstraints, ValidationError

from exosight.errors import InputError

CONFIG = ConfigDict(extra="forbid")
"""Of every pydantic dataclass: an entry that is not known is refused."""

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z_0-9]{0,31}$")]
"""Of a part of a system: letters, digits and underscores, a letter first, at most 32."""
SystemName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z_0-9-]{0,31}$")]
"""Of a system: hyphens too."""


def rising(limits: tuple[float, float]) -> tuple[float, float]:
    """The limits, lower first, as they came; for pydantic's AfterValidator."""
    if limits[0] > limits[1]:
        raise ValueError("expected the lower limit first")  # pydantic adds what it got
    return limits


def first_fault(error: ValidationError) -> str:
    """The first thing wrong, and where, in one sentence."""
    return fault_sentence(error.errors(include_url=False)[0])


def fault_sentence(fault: Mapping[str, Any]) -> str:
    """One of pydantic's error details, and where it is, in one sentence."""
    place = ".".join(str(step) for step in fault["loc"])
    message = fault["msg"].removeprefix("Value error, ")
    got = "" if fault["type"] in ("value_error", "missing") else f", got {str(fault['input'])[:60]!r}"
    return f"{place}: {message}{got}" if place else f"{message}{got}"


def check_name(what: str, name: object, known: Iterable[object]) -> None:
    """InputError unless a name is one of those known."""
    known = list(known)
    if name not in known:
        listed = (
            f"one of {', '.join(map(str, known))}" if known else "none, as there is nothing to choose from"
        )
        raise InputError(f"{what}: expected {listed}, got {name!r}")


def check_unique(what: str, names: Iterable[object]) -> None:
    """InputError unless all names differ."""
    twice = next((name for name, count in Counter(names).items() if count > 1), None)
    if twice is not None:
        raise InputError(f"{what}: expected different names, got {twice} twice")


def first_difference(first: Any, second: Any, name: str = "") -> tuple[str, Any, Any] | None:
    """Name of the first entry in which nested dictionaries differ, and both values; None if they are equal.

    A missing entry has the value None.
    """
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        keys = [*first, *(key for key in second if key not in first)]
        inner = (first_difference(first.get(key), second.get(key), key) for key in keys)
        return next((found for found in inner if found), None)
    return None if first == second else (name, first, second)
