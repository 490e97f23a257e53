"""A folder of picture files, and of its subfolders."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from exosight.errors import DataError
from exosight.files import read_file
from exosight.rig.pictures import Gray, upper_bits
from exosight.vision.pictures import ENDINGS, LARGEST_FILE, decode, natural_order


@dataclass(frozen=True)
class PictureFolder:
    """Picture files in the order of their names, in which img_9 comes before img_10."""

    root: Path
    files: tuple[str, ...]
    """Places in the folder, apart by slashes."""
    _turned: set[int] = field(default_factory=set)
    _deep: set[int] = field(default_factory=set)

    @property
    def names(self) -> tuple[str, ...]:
        """Places in the folder."""
        return self.files

    @property
    def folders(self) -> tuple[str, ...]:
        """Subfolders."""
        return tuple(name.rpartition("/")[0] for name in self.files)

    @property
    def times(self) -> Float64[np.ndarray, " pictures"] | None:
        """The names, if all are numbers."""
        try:
            found = np.array([float(Path(name).stem) for name in self.files])
        except ValueError:
            return None
        return found if np.isfinite(found).all() else None

    time_unit = None

    @property
    def fingerprint(self) -> str:
        """Of the names of the files: one that was damaged is mended by another of its name."""
        return hashlib.sha256("\n".join(self.files).encode()).hexdigest()

    def fingerprint_of(self, places: Iterable[int]) -> str:
        """Of names and sizes of some files."""
        files = [self.files[place] for place in places]
        sizes = [f"{name} {(self.root / name).stat().st_size}" for name in files]
        return hashlib.sha256("\n".join(sizes).encode()).hexdigest()

    def picture(self, place: int) -> Gray:
        """A picture, turned as its file says.

        Raises DataError also for 16 bits a pixel of which the upper 8 are nearly empty.
        """
        path = self.root / self.files[place]
        found = decode(read_file(path, LARGEST_FILE, "expected a picture"), str(path))
        if found.turned:
            self._turned.add(place)
        if found.deep:
            self._deep.add(place)
            return upper_bits(found.gray, str(path))
        return found.gray

    @property
    def notes(self) -> list[str]:
        """Of pictures that were turned, and of those with 16 bits."""
        notes = []
        if self._turned:
            notes.append(f"{len(self._turned)} pictures were turned as their EXIF orientation says")
        if self._deep:
            notes.append(f"of {len(self._deep)} pictures with 16 bits a pixel the upper 8 were taken")
        return notes


def open_folder(root: Path) -> PictureFolder:
    """The pictures of a folder and of its subfolders; DataError if there are none.

    Hidden files and folders are left out.
    """
    found = [
        path.relative_to(root).as_posix()
        for path in root.rglob("*")
        if path.suffix.lower() in ENDINGS and path.is_file()
    ]
    visible = [name for name in found if not any(part.startswith(".") for part in name.split("/"))]
    if not visible:
        raise DataError(f"{root}: no pictures in it; expected files that end in {', '.join(ENDINGS)}")
    return PictureFolder(root, tuple(sorted(visible, key=natural_order)))
