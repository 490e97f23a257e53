"""What may be an input of a network beside the images that it reads; usable without PyTorch."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, UInt8

from exosight.errors import InputError
from exosight.learning.outputs import command_scale
from exosight.system.schema import Channel, Schema


@dataclass(frozen=True)
class ModelInputs:
    """Earlier images and commands, a row an image; None for a network that has no such input."""

    history: UInt8[np.ndarray, "frames history height width"] | None = None
    """gray images of the same system before it, the newest first; the image itself where there was none"""
    commands: Float32[np.ndarray, "frames channels"] | None = None
    """[the channels' units]"""


HISTORY_SPACING = "history_spacing"
"""Entry of a run's data identity: the usual `command_change` from an image to the next [-]."""

IMAGE_ONLY = ModelInputs()
"""For a network that reads an image alone."""


def command_change(
    schema: Schema, before: Float[np.ndarray, "*batch channels"], after: Float[np.ndarray, "*batch channels"]
) -> Float[np.ndarray, "*batch"]:
    """How far commands have moved: the largest change of a channel, in quarters of its peak."""
    return np.asarray(np.max(np.abs(after - before) / command_scale(schema), axis=-1, initial=0.0))


def check_inputs(images: np.ndarray, inputs: ModelInputs, history: int, channels: Sequence[Channel]) -> None:
    """Refuse inputs that a network does not have.

    history    how many earlier images it has as inputs
    channels   whose commands are an input

    Raises InputError that says what to give.
    """
    count, *size = images.shape
    commands = f"commands ({', '.join(f'{c.name} [{c.unit}]' for c in channels)})"
    wanted = (
        _named("history", np.dtype(np.uint8), (count, history, *size)) if history else "no history",
        _named(commands, np.dtype(np.float32), (count, len(channels))) if channels else "no commands",
    )
    found = (
        "no history"
        if inputs.history is None
        else _named("history", inputs.history.dtype, inputs.history.shape),
        "no commands"
        if inputs.commands is None
        else _named(commands if channels else "commands", inputs.commands.dtype, inputs.commands.shape),
    )
    if found != wanted:
        raise InputError(
            f"beside the image, this network expects {' and '.join(wanted)}, got {' and '.join(found)}; give "
            "OnnxEstimator.read its ModelInputs, or a network trained with other --history, --actuation"
        )
    if inputs.commands is not None and not np.isfinite(inputs.commands).all():
        raise InputError("commands: expected finite numbers, got NaN or infinity among them")


def stacked(images: np.ndarray, inputs: ModelInputs) -> UInt8[np.ndarray, "frames stack height width"]:
    """Images as the network takes them: each with those before it."""
    own = images[:, None]
    return own if inputs.history is None else np.concatenate([own, inputs.history], axis=1)


def _named(name: str, dtype: np.dtype, shape: tuple[int, ...]) -> str:
    return f"{name} {dtype} {shape}"
