"""Cards of networks that nobody has trained."""

from typing import Any

from exosight.learning.intervals import Widths
from exosight.learning.model_file import ModelCard


def made_up(image_height: int, image_width: int, **known: Any) -> ModelCard:
    """A card that says nothing in particular, but for its image's size and what is given."""
    return ModelCard(
        **{
            "exosight_version": "0.1.0",
            "network": "made up",
            "seed": 0,
            "image_height": image_height,
            "image_width": image_width,
            "input": "gray",
            "contacts": ("C1", "C2", "C3", "C4", "C5", "C6", "C7"),
            "unit": "N",
            "epoch": 1,
            "validation_l1": 0.0,
            "training": {},
            "data": {},
            "widths": Widths(((1.0,) * 7,) * 5, ((1.0,) * 7,) * 5),
            "ood_limit": 1.0,
            **known,
        }
    )
