"""Schemas of systems that nobody simulates."""

from dataclasses import replace

from exosight.exosuit.published import PublishedDesigns
from exosight.system.camera import Visibility
from exosight.system.schema import Channel, Schema, SensorSpec, ViewSpec

_PUBLISHED = PublishedDesigns().schema


def published_schema(height: int = 128, width: int = 128, visibility: Visibility = "stacked") -> Schema:
    """That of the published system, with images of another size."""
    return replace(_PUBLISHED, cameras=(ViewSpec("camera", width, height, visibility),))


def mixed_schema(height: int = 32, width: int = 32) -> Schema:
    """Three zones of force and a joint angle are estimated; one more angle is not. Two channels."""
    zones = tuple(SensorSpec(f"zone_{i}", "contact force", "N", estimated=True) for i in range(3))
    return Schema(
        "hand",
        (Channel("pressure", "kPa", 0.0, 80.0), Channel("cable", "N", 0.0, 4.0)),
        (
            zones[0],
            SensorSpec("knuckle_of_the_index", "joint angle", "rad", estimated=True),
            *zones[1:],
            SensorSpec("grip", "net force", "N", parts=("zone_1", "zone_2")),
            SensorSpec("wrist", "joint angle", "rad"),
        ),
        (ViewSpec("side", width, height),),
    )
