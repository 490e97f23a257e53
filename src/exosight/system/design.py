"""The parameters in which the systems of a set differ; usable without JAX."""

from collections.abc import Mapping
from dataclasses import dataclass

from pydantic import JsonValue


@dataclass(frozen=True)
class Design:
    """One member of a set of designs.

    number       its place in the set, 0, 1, 2 …
    family       index into the set's families: what kind it is
    scenario     index into the set's scenarios: what varies in it
    parameters   in which it differs from the others, as JSON values
    """

    number: int
    family: int
    scenario: int
    parameters: Mapping[str, JsonValue]
