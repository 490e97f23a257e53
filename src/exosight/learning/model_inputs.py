"""What a network may be shown beside the images that it reads; usable without PyTorch."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, UInt8

from exosight.errors import InputError


@dataclass(frozen=True)
class ModelInputs:
    """Earlier images and actuation, a row an image; None for a network that asks for none."""

    history: UInt8[np.ndarray, "frames history height width"] | None = None
    """gray images of the same exosuit before it, the newest first; the image itself where there was none"""
    u: Float32[np.ndarray, " frames"] | None = None
    """actuation [N]"""


HISTORY_SPACING = "history_spacing"
"""Entry of a run's data identity: the usual change of u from an image to the next [N]."""

IMAGE_ONLY = ModelInputs()
"""For a network that reads an image alone."""


def check_inputs(images: np.ndarray, inputs: ModelInputs, history: int, actuation: bool) -> None:
    """Refuse what a network is not to be shown beside images.

    history, actuation   what it asks for: so many earlier images, and u

    Raises InputError that says what to give.
    """
    count, *size = images.shape
    wanted = (
        _named("history", np.dtype(np.uint8), (count, history, *size)) if history else "no history",
        _named("u [N]", np.dtype(np.float32), (count,)) if actuation else "no u",
    )
    found = (
        "no history"
        if inputs.history is None
        else _named("history", inputs.history.dtype, inputs.history.shape),
        "no u" if inputs.u is None else _named("u [N]", inputs.u.dtype, inputs.u.shape),
    )
    if found != wanted:
        raise InputError(
            f"beside the image, this network expects {' and '.join(wanted)}, got {' and '.join(found)}; give "
            "OnnxEstimator.read its ModelInputs, or a network trained with other --history, --actuation"
        )
    if inputs.u is not None and not np.isfinite(inputs.u).all():
        raise InputError("u: expected finite newtons, got NaN or infinity among them")


def stacked(images: np.ndarray, inputs: ModelInputs) -> UInt8[np.ndarray, "frames stack height width"]:
    """Images as the channels that a network sees: each with those before it."""
    own = images[:, None]
    return own if inputs.history is None else np.concatenate([own, inputs.history], axis=1)


def _named(name: str, dtype: np.dtype, shape: tuple[int, ...]) -> str:
    return f"{name} {dtype} {shape}"
