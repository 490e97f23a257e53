"""Cards of networks that nobody has trained."""

from typing import Any

from schemas import published_schema

from exosight.learning.intervals import Widths
from exosight.learning.model_file import ModelCard


def made_up(image_height: int, image_width: int, **known: Any) -> ModelCard:
    """A card of the published system that says nothing in particular, but for its image size."""
    schema = known.get("schema", published_schema(image_height, image_width))
    ones = ((1.0,) * len(schema.outputs),) * 5
    return ModelCard(
        **{
            "exosight_version": "0.1.0",
            "network": "made up",
            "seed": 0,
            "schema": schema,
            "input": "gray",
            "epoch": 1,
            "validation_l1": 0.0,
            "training": {},
            "data": {},
            "widths": Widths(ones, ones),
            "ood_limit": 1.0,
            **known,
        }
    )
