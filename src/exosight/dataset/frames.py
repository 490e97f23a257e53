"""Labelled images in memory: one array a quantity, one row a frame."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64, Int, Int8, Int32, Int64, UInt8

from exosight.exosuit.scenarios import SCENARIOS
from exosight.exosuit.shapes import FAMILIES


@dataclass(frozen=True)
class Frames:
    """Images of exosuit and finger with everything that is known about each."""

    images: UInt8[np.ndarray, "frames height width"]
    """Gray images, 0…255."""
    forces: Float32[np.ndarray, "frames 7"]
    """Contact force on the finger spheres C1…C7 [N]."""
    u: Float32[np.ndarray, " frames"]
    """Actuation [N], positive pushes."""
    pose: Float64[np.ndarray, "frames dofs"]
    """Generalised coordinates of the plant: bending [rad], stretch [-], then joint angles [rad]."""
    shape_id: Int32[np.ndarray, " frames"]
    """Exosuit shape, as numbered in the list of shapes."""
    family: Int8[np.ndarray, " frames"]
    """Index into the families of shapes."""
    scenario: Int8[np.ndarray, " frames"]
    """Index into the scenarios."""
    loading: Int8[np.ndarray, " frames"]
    """+1 while the actuation rises, −1 while it falls."""

    def __len__(self) -> int:
        return len(self.u)


@dataclass(frozen=True)
class Quantity:
    """How one quantity of `Frames` is stored and read by others."""

    dtype: Any
    unit: str
    meaning: str


QUANTITIES: dict[str, Quantity] = {
    "images": Quantity(np.uint8, "gray level 0-255", "image, row by row from the top left"),
    "forces": Quantity(np.float32, "N", "contact force on the finger spheres C1 to C7"),
    "u": Quantity(np.float32, "N", "actuation, positive pushes"),
    "pose": Quantity(np.float64, "rad, -, rad", "generalised coordinates: rod strains, then joint angles"),
    "shape_id": Quantity(np.int32, "-", "exosuit shape, as numbered in the manifest"),
    "family": Quantity(np.int8, "-", "index into the manifest's families, from 0"),
    "scenario": Quantity(np.int8, "-", "index into the manifest's scenarios, from 0"),
    "loading": Quantity(np.int8, "-", "+1 while the actuation rises, -1 while it falls"),
}
"""Type, unit and meaning of every array of `Frames`, written beside it on disk."""


CAUSES = ("not_converged", "crosses_itself", "tip_below_finger")
"""Why a simulated frame is dropped; a frame counts under the first cause that holds."""


Columns = dict[str, Float64[np.ndarray, " frames"]]
"""Numbers by name, one a frame, such as what was drawn for each."""


def take(frames: Frames, index: Int[np.ndarray, " picked"]) -> Frames:
    """The frames at the given places, in that order."""
    return Frames(**{name: getattr(frames, name)[index] for name in QUANTITIES})


def previous(frames: Frames) -> Int64[np.ndarray, " frames"]:
    """The place of the frame before each on the path of its exosuit.

    At u = 0, and where a path begins, it is the frame's own: the exosuit was at rest before it was driven.
    """
    here, before = slice(1, None), slice(None, -1)
    way = (frames.u[here] - frames.u[before]) * frames.loading[here]
    follows = (frames.shape_id[here] == frames.shape_id[before]) & (way >= 0) & (frames.u[here] != 0)
    follows &= frames.loading[here] <= frames.loading[before]  # a path rises, then falls
    places = np.arange(len(frames))
    places[here] -= follows
    return places


def concatenate(parts: Sequence[Frames]) -> Frames:
    """All frames of several sets, one set after the other; the sets share image size and coordinates."""
    return Frames(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in QUANTITIES})


def find_fault(frames: Frames, load_limit: float = np.inf) -> str | None:
    """What makes these frames unfit for use, in words, or None if nothing does.

    load_limit  largest magnitude of the actuation [N]
    """
    for field in fields(Frames):
        values, quantity = getattr(frames, field.name), QUANTITIES[field.name]
        if values.dtype != quantity.dtype:
            return f"{field.name} expects {np.dtype(quantity.dtype)}, got {values.dtype}"
        if len(values) != len(frames):
            return f"{field.name} has {len(values)} frames, u has {len(frames)}"
        if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
            return f"{field.name} holds values that are not finite"
    limits = {
        "forces": (0.0, np.inf),
        "u": (-float(load_limit), float(load_limit)),  # plain floats: compared as float32, as stored
        "shape_id": (0, np.inf),
        "family": (0, len(FAMILIES) - 1),
        "scenario": (0, len(SCENARIOS) - 1),
    }
    for name, (low, high) in limits.items():
        values = getattr(frames, name)
        outside = values[(values < low) | (values > high)]
        if outside.size:
            return f"{name} must lie within {low:g}…{high:g} {QUANTITIES[name].unit}, got {outside.flat[0]:g}"
    if not np.all(np.abs(frames.loading) == 1):
        return "loading must be +1 or −1"
    return None
