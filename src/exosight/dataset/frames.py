"""Labelled images in memory: one array a quantity, one row a frame.

Measured frames have no pose and perhaps no commands, and what is a design of simulated ones is a sequence of
theirs: pictures taken one after the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64, Int, Int8, Int32, Int64, UInt8

from exosight.errors import InputError
from exosight.system.schema import Schema, difference


@dataclass(frozen=True)
class Frames:
    """Images of a system with everything that is known about each."""

    schema: Schema
    """Names, units and ranges of what the arrays hold."""
    images: UInt8[np.ndarray, "frames height width"]
    """Gray images of the schema's first camera, 0…255."""
    sensors: Float32[np.ndarray, "frames sensors"]
    """What every sensor reads, in the schema's order and units."""
    commands: Float32[np.ndarray, "frames channels"]
    """Command of every channel, in the schema's order and units."""
    pose: Float64[np.ndarray, "frames dofs"]
    """Generalised coordinates, body by body."""
    design: Int32[np.ndarray, " frames"]
    """Number of the design in its dataset."""
    family: Int8[np.ndarray, " frames"]
    """Index into the dataset's families."""
    scenario: Int8[np.ndarray, " frames"]
    """Index into the dataset's scenarios."""
    step: Int32[np.ndarray, " frames"]
    """Place on the load path of the design, 0 …; places of frames left out are missing."""

    def __len__(self) -> int:
        return len(self.step)

    @property
    def labels(self) -> Float32[np.ndarray, "frames outputs"]:
        """What the sensors read that networks estimate, in the order of the schema's outputs."""
        return self.sensors[:, self.schema.output_indices()]

    def reading(self, name: str) -> Float32[np.ndarray, " frames"]:
        """What one sensor reads [its unit]; InputError if there is none of this name."""
        return self.sensors[:, self.schema.index(name)]


@dataclass(frozen=True)
class Quantity:
    """How one array of `Frames` is stored and read by others."""

    dtype: Any
    unit: str
    meaning: str


QUANTITIES: dict[str, Quantity] = {
    "images": Quantity(np.uint8, "gray level 0-255", "image, row by row from the top left"),
    "sensors": Quantity(np.float32, "as in the schema", "what every sensor reads, in the schema's order"),
    "commands": Quantity(np.float32, "as in the schema", "command of every channel, in the schema's order"),
    "pose": Quantity(np.float64, "rad or -", "generalised coordinates, body by body"),
    "design": Quantity(np.int32, "-", "design, as numbered in the manifest"),
    "family": Quantity(np.int8, "-", "index into the manifest's families, from 0"),
    "scenario": Quantity(np.int8, "-", "index into the manifest's scenarios, from 0"),
    "step": Quantity(np.int32, "-", "place on the load path of the design, from 0"),
}
"""Type, unit and meaning of every array of `Frames`, written beside it on disk."""


Columns = dict[str, Float64[np.ndarray, " frames"]]
"""Numbers by name, one a frame, such as what was drawn for each."""


def row_shapes(schema: Schema, dofs: int) -> dict[str, tuple[int, ...]]:
    """Shape of one row of each array whose rows are more than a number."""
    return {
        "images": schema.image_size,
        "sensors": (len(schema.sensors),),
        "commands": (len(schema.channels),),
        "pose": (dofs,),
    }


def take(frames: Frames, index: Int[np.ndarray, " picked"]) -> Frames:
    """The frames at the given places, in that order."""
    return Frames(frames.schema, **{name: getattr(frames, name)[index] for name in QUANTITIES})


def concatenate(parts: Sequence[Frames]) -> Frames:
    """All frames of several sets, one set after the other.

    Raises InputError if their schemas or the numbers of their coordinates differ.
    """
    first = parts[0]
    for part in parts[1:]:
        fault = difference(first.schema, part.schema)
        if fault is None and part.pose.shape[1] != first.pose.shape[1]:
            fault = f"expected {first.pose.shape[1]} coordinates, got {part.pose.shape[1]}"
        if fault:
            raise InputError(f"datasets: expected one kind of system; {fault}")
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in QUANTITIES}
    return Frames(first.schema, **arrays)


def previous(frames: Frames) -> Int64[np.ndarray, " frames"]:
    """The place of the frame before each on the path of its design.

    Without commands, and where a path begins, it is the frame's own: the system was at rest before.
    """
    here, before = slice(1, None), slice(None, -1)
    follows = (frames.design[here] == frames.design[before]) & (frames.step[here] > frames.step[before])
    follows &= np.any(frames.commands[here] != 0, axis=1)
    places = np.arange(len(frames))
    places[here] -= follows
    return places


def direction(frames: Frames, channel: int = 0) -> Int8[np.ndarray, " frames"]:
    """+1 up to the first largest command of a channel on the path of each design, −1 after it.

    0 where the system has no channel.
    """
    if not frames.schema.channels:
        return np.zeros(len(frames), np.int8)
    found = np.ones(len(frames), np.int8)
    size = np.abs(frames.commands[:, channel])
    for number in np.unique(frames.design):
        own = np.flatnonzero(frames.design == number)
        own = own[np.argsort(frames.step[own], kind="stable")]
        found[own[np.argmax(size[own]) + 1 :]] = -1
    return found


def find_fault(frames: Frames, families: int, scenarios: int) -> str | None:
    """What makes these frames unfit for use, in words, or None if nothing does.

    families, scenarios   how many there are
    """
    shapes = row_shapes(frames.schema, frames.pose.shape[-1])
    for name, quantity in QUANTITIES.items():
        values = getattr(frames, name)
        if values.dtype != quantity.dtype:
            return f"{name} expects {np.dtype(quantity.dtype)}, got {values.dtype}"
        if values.shape[1:] != shapes.get(name, ()):
            return f"{name} expects {shapes.get(name, ())} a frame, got {values.shape[1:]}"
        if len(values) != len(frames):
            return f"{name} has {len(values)} frames, step has {len(frames)}"
        if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
            return f"{name} holds values that are not finite"
    for name, most in (("design", None), ("family", families), ("scenario", scenarios), ("step", None)):
        values = getattr(frames, name)
        outside = values[(values < 0) | (values >= most if most is not None else False)]
        if outside.size:
            within = "at least 0" if most is None else f"within 0…{most - 1}"
            return f"{name} must be {within}, got {outside.flat[0]:g}"
    for channel, values in zip(frames.schema.channels, frames.commands.T, strict=True):
        # As plain floats: compared as float32, as stored.
        outside = values[(values < channel.low) | (values > channel.high)]
        if outside.size:
            return (
                f"commands: {channel.name} must lie within {channel.low:g}…{channel.high:g} {channel.unit}, "
                f"got {outside.flat[0]:g}"
            )
    for sensor, values in zip(frames.schema.sensors, frames.sensors.T, strict=True):
        if sensor.quantity == "contact force" and np.any(values < 0):
            return f"sensors: {sensor.name} is a magnitude and must be at least 0, got {values.min():g}"
    return None
