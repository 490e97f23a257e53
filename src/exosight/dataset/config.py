"""What a user chooses about a dataset; usable without JAX."""

import operator
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from exosight.exosuit.variation import PlantVariation
from exosight.system.camera import Camera
from exosight.validation import CONFIG
from exosight.vision.appearance import AppearanceVariation
from exosight.vision.lighting import LightingVariation

DESIGNS = 100
"""Designs of a system file unless a configuration says how many."""

PUBLISHED_ONLY = ("per_scenario", "young", "contact_stiffness", "gap", "camera", "plant")
"""Options that only the published system has; a file says these things itself."""


@dataclass(frozen=True, config=CONFIG)
class GenerateConfig:
    """What a dataset is made of."""

    system: Annotated[str, Field(min_length=1, max_length=4096)] = "published"
    """name of a system, or a system file (*.toml)"""
    designs: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    """designs of a system file; 100 unless it is given"""
    view: Annotated[str | None, Field(max_length=64, exclude_if=lambda name: name is None)] = None
    """camera of a system file that the images are of, by its name; the first unless it is given"""
    per_scenario: Annotated[int, Field(ge=1, le=401)] = 10
    """published system: shapes of each of the eleven scenarios; the paper has 125"""
    frames: Annotated[int, Field(ge=2, le=10_000)] = 50
    """frames of each design, evenly along its load path"""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """seed of the designs, their paths and all that varies"""
    young: Annotated[float, Field(ge=1e3, le=1e9)] = 300e3
    """published system: Young's modulus of the exosuit [Pa]"""
    contact_stiffness: Annotated[float, Field(ge=1.0, le=1e6)] = 1000.0
    """published system: penalty stiffness of the contact spheres [N/m]"""
    gap: Annotated[float, Field(ge=0.0, le=0.1)] = 0.0
    """published system: clearance between exosuit and finger at the base [m]"""
    camera: Camera = Camera()
    """published system: camera of every image"""
    plant: PlantVariation = PlantVariation()
    """published system: how finger, exosuit and mount differ from shape to shape"""
    lighting: LightingVariation = LightingVariation()
    """how shades and light differ from frame to frame"""
    appearance: AppearanceVariation = AppearanceVariation()
    """how pictures differ from frame to frame"""
    photo: Annotated[bool, Field(exclude_if=operator.not_)] = False
    """pictures as photographs of such a device: perspective, hand, mounts, desks, light, lens, all at random;
    instead of lighting and appearance"""
