"""What a user chooses about a dataset; usable without JAX."""

from typing import Annotated

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from exosight.exosuit.variation import PlantVariation
from exosight.system.camera import Camera
from exosight.vision.appearance import AppearanceVariation
from exosight.vision.lighting import LightingVariation


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class GenerateConfig:
    """What a dataset is made of."""

    per_scenario: Annotated[int, Field(ge=1, le=401)] = 10
    """shapes of each of the eleven scenarios; the paper has 125"""
    frames: Annotated[int, Field(ge=2, le=10_000)] = 50
    """frames of each shape, evenly along 0 → 4 → 0 N"""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """seed of the shapes and of all that varies"""
    young: Annotated[float, Field(ge=1e3, le=1e9)] = 300e3
    """Young's modulus of the exosuit [Pa]"""
    contact_stiffness: Annotated[float, Field(ge=1.0, le=1e6)] = 1000.0
    """penalty stiffness of the contact spheres [N/m]"""
    gap: Annotated[float, Field(ge=0.0, le=0.1)] = 0.0
    """clearance between exosuit and finger at the base [m]"""
    camera: Camera = Camera()
    """camera of every image"""
    plant: PlantVariation = PlantVariation()
    """how finger, exosuit and mount differ from shape to shape"""
    lighting: LightingVariation = LightingVariation()
    """how shades and light differ from frame to frame"""
    appearance: AppearanceVariation = AppearanceVariation()
    """how pictures differ from frame to frame"""
