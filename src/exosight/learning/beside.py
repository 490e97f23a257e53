"""What a network may be shown beside the images that it reads; usable without PyTorch."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, UInt8

from exosight.errors import InputError


@dataclass(frozen=True)
class Beside:
    """Earlier images and actuation, a row an image; None for a network that asks for none."""

    past: UInt8[np.ndarray, "frames past height width"] | None = None
    """gray images of the same exosuit before it, the newest first; the image itself where there was none"""
    u: Float32[np.ndarray, " frames"] | None = None
    """actuation [N]"""


APART = "past_apart"
"""Entry of a run's data identity: the usual change of u from an image to the next [N]."""

NOTHING = Beside()
"""For a network that reads an image alone."""


def check_beside(images: np.ndarray, beside: Beside, past: int, actuation: bool) -> None:
    """Refuse what a network is not to be shown beside images.

    past, actuation   what it asks for: so many earlier images, and u

    Raises InputError that says what to give.
    """
    count, *size = images.shape
    wanted = (
        _named("past", np.dtype(np.uint8), (count, past, *size)) if past else "no past",
        _named("u [N]", np.dtype(np.float32), (count,)) if actuation else "no u",
    )
    found = (
        "no past" if beside.past is None else _named("past", beside.past.dtype, beside.past.shape),
        "no u" if beside.u is None else _named("u [N]", beside.u.dtype, beside.u.shape),
    )
    if found != wanted:
        raise InputError(
            f"beside the image, this network expects {' and '.join(wanted)}, got {' and '.join(found)}; give "
            "OnnxEstimator.read its Beside, or choose a network trained with other --past and --actuation"
        )
    if beside.u is not None and not np.isfinite(beside.u).all():
        raise InputError("u: expected finite newtons, got NaN or infinity among them")


def stacked(images: np.ndarray, beside: Beside) -> UInt8[np.ndarray, "frames stack height width"]:
    """Images as the channels that a network sees: each with those before it."""
    own = images[:, None]
    return own if beside.past is None else np.concatenate([own, beside.past], axis=1)


def _named(name: str, dtype: np.dtype, shape: tuple[int, ...]) -> str:
    return f"{name} {dtype} {shape}"
