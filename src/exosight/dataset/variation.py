"""What varies in a dataset: drawn from its seed, exosuit by exosuit and frame by frame, and kept as numbers.

This module needs JAX; `exosight.dataset.store.read_variation` reads what was kept without it.
"""

from dataclasses import fields

import numpy as np
from jaxtyping import Int64

from exosight.dataset.config import GenerateConfig
from exosight.dataset.frames import Columns, Frames
from exosight.exosuit.assembly import MAX_FORCE
from exosight.exosuit.variation import PlantVariation, Variant, draw_variant
from exosight.vision.appearance import COLUMNS, Appearance, AppearanceVariation, draw_appearance
from exosight.vision.lighting import Lighting, LightingVariation, draw_lighting

_LIGHTING, _APPEARANCE = 1, 2  # streams of the dataset's seed


def variant_of(config: GenerateConfig, shape_id: int) -> Variant:
    """How the exosuit and the finger of one shape of a dataset differ from the nominal ones."""
    return draw_variant(config.plant, config.seed, shape_id)


def lighting_of(config: GenerateConfig, numbers: Int64[np.ndarray, " frames"]) -> Lighting:
    """Shades and light of the frames of a dataset with these numbers."""
    return draw_lighting(config.lighting, (config.seed, _LIGHTING), numbers)


def appearance_of(config: GenerateConfig, numbers: Int64[np.ndarray, " frames"]) -> Appearance:
    """What became of the pictures of the frames of a dataset with these numbers."""
    return draw_appearance(config.appearance, (config.seed, _APPEARANCE), numbers)


def frame_numbers(config: GenerateConfig, frames: Frames) -> Int64[np.ndarray, " frames"]:
    """Number of each frame of a dataset, whether frames before it were dropped or not.

    number = shape_id · (frames a shape) + place on the path 0 → 4 → 0 N
    """
    gone = np.where(frames.loading > 0, frames.u, 2 * MAX_FORCE - frames.u)  # [N]
    place = np.rint(gone * (config.frames - 1) / (2 * MAX_FORCE)).astype(np.int64)
    return frames.shape_id.astype(np.int64) * config.frames + place


def variation_columns(config: GenerateConfig, frames: Frames) -> Columns:
    """All that was drawn for frames of a dataset, by name: none of what does not vary.

    Names are `plant.` and a field of `Variant` (of several numbers, with the number's place), `lighting.` and
    a field of `Lighting`, `appearance.` and a field of `Appearance`.
    """
    numbers = frame_numbers(config, frames)
    columns: Columns = {}
    if config.plant != PlantVariation():
        shapes, of = np.unique(frames.shape_id, return_inverse=True)
        variants = [variant_of(config, int(shape)) for shape in shapes]
        for field in fields(Variant):
            values = np.array([getattr(variant, field.name) for variant in variants], dtype=float)
            if values.ndim == 1:
                columns[f"plant.{field.name}"] = values[of]
            else:
                columns |= {f"plant.{field.name}_{k}": row[of] for k, row in enumerate(values.T)}
    if config.lighting != LightingVariation():
        lighting = lighting_of(config, numbers)
        columns["lighting.finger_shade"] = lighting.finger_shade
        columns["lighting.exosuit_shade"] = lighting.exosuit_shade
        for name, direction in zip(("right", "up", "towards"), lighting.light.lamp.T, strict=True):
            columns[f"lighting.lamp_{name}"] = direction
        columns["lighting.ambient"] = lighting.light.ambient
    if config.appearance != AppearanceVariation():
        appearance = appearance_of(config, numbers)
        columns |= {f"appearance.{name}": getattr(appearance, name) for name in COLUMNS}
    return columns
