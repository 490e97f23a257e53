"""What all sources of pictures have in common: an order, a size, and the part and size that are stored."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64, UInt8

from exosight.errors import DataError, InputError
from exosight.vision.pictures import resized, same_aspect

SMALLEST, LARGEST, MULTIPLE = 32, 1024, 4
"""Sides of the pictures that are stored [pixels]: from, to, and multiples of. Networks take no others."""

_DARK = 16
"""Gray level of 8 bits that a picture of 16 must reach: below are the low bits of a 12-bit camera."""

Gray = UInt8[np.ndarray, "rows columns"]
Size = tuple[int, int]
"""Width and height [pixels]."""
Region = tuple[int, int, int, int]
"""Left edge, upper edge, width and height of a part of a picture [pixels]."""


@runtime_checkable
class PictureSource(Protocol):
    """Pictures of one camera, all of one size, in an order."""

    @property
    def names(self) -> tuple[str, ...]:
        """What messages call each picture; a table may name them so."""
        ...

    @property
    def folders(self) -> tuple[str, ...]:
        """Folder of each within the source; empty where there are none."""
        ...

    @property
    def times(self) -> Float64[np.ndarray, " pictures"] | None:
        """When each was taken, in the unit of `time_unit`; None: unknown."""
        ...

    @property
    def time_unit(self) -> str | None:
        """Of the times; None: that of the table they are compared with."""
        ...

    @property
    def fingerprint(self) -> str:
        """Changes if pictures are added or removed."""
        ...

    def picture(self, place: int) -> Gray:
        """One picture, gray 0…255; DataError if it cannot be read. Asking in rising order is fast."""
        ...

    @property
    def notes(self) -> list[str]:
        """What is to be said of the pictures read so far."""
        ...


@dataclass(frozen=True)
class Fit:
    """How pictures of one size become those that are stored."""

    source: Size
    region: Region
    size: Size

    def apply(self, picture: Gray, name: str) -> UInt8[np.ndarray, "height width"]:
        """A picture as it is stored; InputError if it has another size than the first one."""
        rows, columns = picture.shape
        if (columns, rows) != self.source:
            raise InputError(
                f"{name}: expected {_sides(self.source)} pixels as the first picture has, got "
                f"{columns}×{rows}; pictures of one dataset are of one camera, so import others apart"
            )
        left, top, width, height = self.region
        part = picture[top : top + height, left : left + width]
        return part if (width, height) == self.size else resized(part, *self.size)

    @property
    def remembered(self) -> dict[str, dict[str, list[int]]]:
        """What networks remember of it, if a part is taken: size of the pictures, and the part [pixels]."""
        if self.region == (0, 0, *self.source):
            return {}
        return {"taken": {"picture": list(self.source), "part": list(self.region)}}

    @property
    def words(self) -> str:
        """In a sentence for users."""
        whole = self.region == (0, 0, *self.source)
        part = "" if whole else f", the part {' '.join(map(str, self.region))}"
        stored = "" if self.region[2:] == self.size else f", stored as {_sides(self.size)}"
        return f"{_sides(self.source)} pixels{part}{stored}"


def fit_of(picture: Gray, region: Region | None, size: Size | None) -> Fit:
    """How pictures of the size of this one are stored.

    region  the part of each that is taken; by default all of it
    size    in which it is stored; by default its own, or the nearest that networks take

    Raises InputError for a part that leaves the picture, a size that networks do not take, or one of another
    aspect ratio.
    """
    rows, columns = picture.shape
    left, top, width, height = part = region or (0, 0, columns, rows)
    if not (
        left >= 0
        and top >= 0
        and min(width, height) >= 1
        and left + width <= columns
        and top + height <= rows
    ):
        raise InputError(
            f"crop: expected left, top, width and height within {columns}×{rows} pixels, got "
            f"{' '.join(map(str, part))}"
        )
    if size is None:
        size = _nearest_size((width, height))
    if any(not SMALLEST <= side <= LARGEST or side % MULTIPLE for side in size):
        raise InputError(
            f"size: expected sides of {SMALLEST} to {LARGEST} pixels in multiples of {MULTIPLE}, got "
            f"{_sides(size)}"
        )
    if not same_aspect((height, width), *size):
        raise InputError(
            f"size: expected the aspect ratio of {_sides((width, height))} pixels, got {_sides(size)}; a "
            "stretched picture shows another pose, so choose another size, or a part with --crop"
        )
    return Fit((columns, rows), part, size)


def upper_bits(gray: Gray, name: str) -> Gray:
    """The upper 8 of 16 bits a pixel; DataError if they are nearly empty."""
    if gray.max() < _DARK:
        raise DataError(
            f"{name}: 16 bits a pixel, but no value above {256 * int(gray.max()) + 255} of 65535, which is "
            "black in 8 bits; scale the pictures to the full range, or save them with 8 bits"
        )
    return gray


def _nearest_size(own: Size) -> Size:
    """Of the sizes that networks take and that have this aspect ratio, the nearest in area."""
    width, height = own
    sides = np.arange(SMALLEST, LARGEST + 1, MULTIPLE)
    wide, high = np.meshgrid(sides, sides, indexing="ij")
    same = np.abs(width * high - height * wide) <= np.maximum(np.maximum(wide, high), max(own))
    if not same.any():
        raise InputError(
            f"pictures of {_sides(own)} pixels: expected sides that both fit {SMALLEST} to {LARGEST} pixels; "
            "take a part of them with --crop"
        )
    far = np.abs(np.log(wide * high / (width * height)))
    # Among sizes of one area the one whose aspect ratio is nearest.
    far = np.where(same, far + 1e-3 * np.abs(np.log(wide * height / (width * high))), np.inf)
    i, j = np.unravel_index(int(np.argmin(far)), far.shape)
    return int(sides[i]), int(sides[j])


def _sides(size: Size) -> str:
    return "×".join(map(str, size))
