"""What varies in a dataset: drawn from its seed, design by design and frame by frame, and kept as numbers.

This module needs JAX; `exosight.dataset.store.read_variation` reads what was kept without it.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int64

from exosight.dataset.config import GenerateConfig
from exosight.dataset.frames import Columns, Frames
from exosight.system.design import Design
from exosight.system.designs import DesignSet
from exosight.system.system import System
from exosight.validation import check_name
from exosight.vision.appearance import AppearanceVariation
from exosight.vision.augment import Appearance, draw_appearance
from exosight.vision.lighting import Lighting, LightingVariation, draw_lighting

_LIGHTING, _APPEARANCE, PHOTO = 1, 2, 3  # streams of the dataset's seed


def shades_of(config: GenerateConfig, system: System) -> dict[str, float]:
    """Nominal shade of every tube, by its name; InputError if the shade of another is to vary."""
    shades = {tube.name: tube.shade for tube in system.tubes}
    for name in config.lighting.shades:
        check_name("lighting.shades", name, shades)
    return shades


def lighting_of(config: GenerateConfig, numbers: Int64[np.ndarray, " frames"], system: System) -> Lighting:
    """Shades and light of the frames of a dataset with these numbers."""
    return draw_lighting(config.lighting, (config.seed, _LIGHTING), numbers, shades_of(config, system))


def appearance_of(config: GenerateConfig, numbers: Int64[np.ndarray, " frames"]) -> Appearance:
    """What became of the pictures of the frames of a dataset with these numbers."""
    return draw_appearance(config.appearance, (config.seed, _APPEARANCE), numbers)


def frame_numbers(config: GenerateConfig, frames: Frames) -> Int64[np.ndarray, " frames"]:
    """Number of each frame of a dataset, whether frames before it were dropped or not.

    number = design · (frames a design) + step
    """
    return frames.design.astype(np.int64) * config.frames + frames.step


def variation_columns(
    config: GenerateConfig, designs: DesignSet, chosen: Sequence[Design], frames: Frames
) -> Columns:
    """All that was drawn for frames of a dataset, by name: none of what does not vary.

    Names are `plant.` and a name of `DesignSet.numbers`, `lighting.` and a field of `Lighting` (of a shade,
    the tube's name and `_shade`), `appearance.` and a column of `Appearance`.
    """
    numbers = frame_numbers(config, frames)
    drawn = {design.number: designs.numbers(design) for design in chosen}
    columns: Columns = {
        f"plant.{name}": np.array([drawn[number][name] for number in frames.design.tolist()])
        for name in drawn[chosen[0].number]
    }
    if config.lighting != LightingVariation():
        system = designs.build(chosen[0])
        lighting = lighting_of(config, numbers, system)
        for tube, values in zip(system.tubes, lighting.shades.T, strict=True):
            columns[f"lighting.{tube.name}_shade"] = values
        for name, direction in zip(("right", "up", "towards"), lighting.light.lamp.T, strict=True):
            columns[f"lighting.lamp_{name}"] = direction
        columns["lighting.ambient"] = lighting.light.ambient
    if config.appearance != AppearanceVariation():
        appearance = appearance_of(config, numbers)
        columns |= {f"appearance.{name}": values for name, values in appearance.columns.items()}
    return columns
