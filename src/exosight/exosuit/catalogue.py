"""Systems by name: the presets of this package, and files of a user's own."""

from pathlib import Path

from exosight.errors import InputError
from exosight.exosuit import index, published
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import Preset, PublishedDesigns
from exosight.exosuit.shapes import TABLE_I, ExosuitShape
from exosight.system.designs import DesignSet, FileDesigns
from exosight.system.file import read_system_file
from exosight.system.system import System

PRESETS: dict[str, tuple[Preset, str]] = {
    published.NAME: (
        published.published,
        "the paper's finger and exosuits: eight spheres, one pressure line, one camera",
    ),
    index.NAME: (
        index.index,
        "the same with contact of their surfaces: tapered links, and the exosuit against itself",
    ),
    index.NAME_WITH_FRICTION: (
        index.index_friction,
        "index with Coulomb friction between exosuit and finger, coefficient 0.3",
    ),
}
"""The presets by name, and what each is."""


def find_system(name: str) -> DesignSet:
    """The designs of a preset, or of a system file (a name that ends in .toml or is a path).

    Raises InputError for an unknown name or a file that describes no system, DataError for one that cannot be
    read.
    """
    if name in PRESETS:
        return PublishedDesigns(preset=PRESETS[name][0])
    if name.endswith(".toml") or "/" in name:
        values = read_system_file(Path(name))
        try:
            return FileDesigns(values)
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
    raise InputError(
        f"system: expected {', '.join(PRESETS)} or a file *.toml, got {name!r}; see exosight system list"
    )


def nominal_system(name: str, shape: ExosuitShape = TABLE_I) -> System:
    """A preset with this exosuit, or what a file describes without variation.

    Raises what `find_system` raises.
    """
    designs = find_system(name)
    if isinstance(designs, FileDesigns):
        return designs.build(designs.nominal())
    return PRESETS[name][0](Exosuit(shape), designs.camera)
