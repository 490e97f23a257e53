"""Systems by name: the presets of this package, and files of a user's own."""

from pathlib import Path

from exosight.errors import InputError
from exosight.exosuit.published import NAME, PublishedDesigns, published
from exosight.exosuit.shapes import TABLE_I, ExosuitShape
from exosight.system.designs import DesignSet, FileDesigns
from exosight.system.file import read_system_file
from exosight.system.system import System

PRESETS: dict[str, str] = {
    NAME: "the paper's finger and exosuits: eight spheres, one pressure line, one camera"
}
"""Names of the presets, and what each is."""


def find_system(name: str) -> DesignSet:
    """The designs of a preset, or of a system file (a name that ends in .toml or is a path).

    Raises InputError for an unknown name or a file that describes no system, DataError for one that cannot be
    read.
    """
    if name == NAME:
        return PublishedDesigns()
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
    """The published system with this exosuit, or what a file describes without variation.

    Raises what `find_system` raises.
    """
    designs = find_system(name)
    return designs.build(designs.nominal()) if isinstance(designs, FileDesigns) else published(shape)
