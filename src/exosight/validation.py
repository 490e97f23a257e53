"""What configurations, files and metadata are checked with."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import ConfigDict, StringConstraints, ValidationError

CONFIG = ConfigDict(extra="forbid")
"""Of every pydantic dataclass: an entry that is not known is refused."""

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z_0-9]{0,31}$")]
"""Of a system, or of a part of it: letters, digits and underscores, a letter first, at most 32."""


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
