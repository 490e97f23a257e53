"""What the published system can be set to: an exosuit and its finger, with bounds; needs no JAX."""

import dataclasses
from typing import Annotated, Any, Literal

import pydantic
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from exosight.errors import InputError
from exosight.exosuit.shapes import FAMILIES, ExosuitShape, ranges, shape_from_dict
from exosight.lab.settings import Finite

Family = Literal["linear", "sine", "cosine_sum", "sine_cosine", "legendre"]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class PublishedDesign:
    """A worn exosuit and its finger; only the system published has these."""

    family: Family = "linear"
    """surface of the exosuit"""
    parameters: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=8)] = (0.010, 0.005)
    """its parameters in the order and units of `exosight simulate`: lengths in m, phases in rad"""
    length: Annotated[float, Field(ge=0.07, le=0.11, allow_inf_nan=False)] = 0.095
    """length of the exosuit [m]"""
    young: Annotated[float, Field(ge=1e5, le=1e6, allow_inf_nan=False)] = 300e3
    """Young's modulus of the exosuit [Pa]"""
    gap: Annotated[float, Field(ge=0.0, le=0.01, allow_inf_nan=False)] = 0.0
    """clearance between exosuit and finger at the base [m]"""
    finger_length: Annotated[float, Field(ge=0.8, le=1.25, allow_inf_nan=False)] = 1.0
    """factor on the length of every link of the finger"""
    finger_radius: Annotated[float, Field(ge=0.8, le=1.25, allow_inf_nan=False)] = 1.0
    """factor on the finger's radius"""
    joint_stiffness: Annotated[float, Field(ge=0.5, le=2.0, allow_inf_nan=False)] = 1.0
    """factor on the stiffness of the finger's joints"""


DESIGN = pydantic.TypeAdapter(PublishedDesign)


def values_of(design: PublishedDesign) -> dict[str, Any]:
    """What differs from the nominal design; InputError for parameters that are not the family's."""
    shape_of(design)
    start = PublishedDesign()
    names = [field.name for field in dataclasses.fields(design)]
    dumped = DESIGN.dump_python(design, mode="json")
    return {name: dumped[name] for name in names if getattr(design, name) != getattr(start, name)}


def shape_of(design: PublishedDesign) -> ExosuitShape:
    """The shape of a design's exosuit.

    Raises InputError for another number of parameters, or one outside its range.
    """
    allowed = ranges(FAMILIES[design.family])
    count = sum(each.count for each in allowed.values())
    if len(design.parameters) != count:
        raise InputError(
            f"parameters: the family {design.family} has {count} ({', '.join(allowed)}), "
            f"got {len(design.parameters)}"
        )
    rest, named = list(design.parameters), {}
    for name, each in allowed.items():
        own, rest = rest[: each.count], rest[each.count :]
        named[name] = own if each.count > 1 else own[0]
    return shape_from_dict({"family": design.family, "parameters": named, "length": design.length})
