"""From a dataset's configuration to its designs. This module needs JAX."""

from dataclasses import replace
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from exosight.dataset.config import DESIGNS, PUBLISHED_ONLY, GenerateConfig
from exosight.dataset.manifest import Manifest
from exosight.errors import DataError, InputError
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.catalogue import PRESETS, find_system
from exosight.exosuit.index import FRICTION_DRAWN, NAME_WITH_FRICTION
from exosight.exosuit.published import PublishedDesigns
from exosight.system.design import Design
from exosight.system.designs import DesignSet, FileDesigns
from exosight.system.file import Values
from exosight.validation import first_fault

_NOMINAL = GenerateConfig()


def resolved(config: GenerateConfig) -> tuple[GenerateConfig, Values | None]:
    """The configuration without a folder's name in it, and the entries of its system file, None for a preset.

    Both together make the dataset again anywhere.

    Raises InputError for a system that is not known, options that are not the system's, or a file that
    describes no system; DataError for a file that cannot be read.
    """
    if config.photo and (config.lighting, config.appearance) != (_NOMINAL.lighting, _NOMINAL.appearance):
        raise InputError(
            "photo: such pictures vary in light and appearance already, got one of these as well; leave out "
            "photo, or lighting and appearance"
        )
    found = find_system(config.system)
    description = found.values if isinstance(found, FileDesigns) else None
    if config.view is not None:
        description = _seen_by(config.view, description)
    name = config.system if description is None else Path(config.system).name
    plant = config.plant
    if name == NAME_WITH_FRICTION and plant.friction is None:
        plant = replace(plant, friction=FRICTION_DRAWN)
    config = replace(config, system=name, plant=plant)
    design_set(config, description)
    return config, description


def _seen_by(view: str, description: Values | None) -> Values:
    """A file's entries with one of its cameras alone."""
    cameras = {} if description is None else description["cameras"]
    if description is None or view not in cameras:
        known = ", ".join(cameras) or "that of a preset, which has one"
        raise InputError(f"view: expected a camera of the system file, {known}, got {view!r}")
    return {**description, "cameras": {view: cameras[view]}}


def design_set(config: GenerateConfig, description: Values | None) -> DesignSet:
    """The designs that a dataset is made of.

    description   entries of the system file, None for a preset, as `resolved` or a manifest gives them

    Raises InputError for options that are not the system's.
    """
    if description is None:
        if config.designs is not None:
            raise InputError(
                f"designs: the system {config.system} goes by per_scenario, designs of each of its scenarios"
            )
        nominal = Exosuit(young=config.young, contact_stiffness=config.contact_stiffness, gap=config.gap)
        return PublishedDesigns(nominal, config.plant, config.camera, PRESETS[config.system][0])
    for option in PUBLISHED_ONLY:
        if getattr(config, option) != getattr(_NOMINAL, option):
            raise InputError(
                f"{option}: is an option of the published system alone; {config.system} says it itself"
            )
    return FileDesigns(description)


def draw_designs(config: GenerateConfig, designs: DesignSet) -> tuple[Design, ...]:
    """The designs of a dataset."""
    if isinstance(designs, FileDesigns):
        return designs.draw(config.designs or DESIGNS, config.seed)
    return designs.draw(config.per_scenario, config.seed)


def config_of(manifest: Manifest) -> GenerateConfig:
    """The configuration that made a dataset; DataError if its manifest holds another kind."""
    try:
        return _ADAPTER.validate_python(manifest.config)
    except ValidationError as error:
        raise DataError(f"manifest: no configuration of exosight generate, {first_fault(error)}") from None


_ADAPTER = TypeAdapter(GenerateConfig)
