"""Pictures made what their appearance says: from another camera, before another background, hidden, noisy.

They start from the renderer's clean pictures, in which everything that is BACKGROUND is background. What a
pixel shows of the bodies is taken from there, so that any background can be put behind them.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float64, Integer, UInt8

from exosight.errors import InputError
from exosight.validation import check_name
from exosight.vision.appearance import AppearanceVariation
from exosight.vision.counter_rng import Seed, uniforms
from exosight.vision.pixel_loops import edges
from exosight.vision.renderer import BACKGROUND
from exosight.vision.transforms import TRANSFORMS
from exosight.vision.transforms.base import Canvas, Column, Draws, Picture, Row
from exosight.vision.view import homographies

Pictures = UInt8[np.ndarray, "frames height width"]

SEED = "seed"
"""Column of what is random beyond the transforms' own: a whole number below 2³²."""

COLUMNS: tuple[str, ...] = (*(name for each in TRANSFORMS for name in each.columns), SEED)
"""The numbers of an appearance, in order."""

_NEUTRAL = {name: value for each in TRANSFORMS for name, value in each.columns.items()} | {SEED: 0.0}

_LIGHTEST = 0.70
"""Shade of the lightest body that `coverage` tells from a narrow gap between bodies."""


@dataclass(frozen=True)
class Appearance:
    """What is done to each picture: a column a number, as the classes of TRANSFORMS name them, and the seed.

    Raises InputError for other columns than COLUMNS, or columns of several lengths.
    """

    columns: Mapping[str, Column]

    def __post_init__(self) -> None:
        if tuple(self.columns) != COLUMNS:
            wrong = sorted(set(self.columns) ^ set(COLUMNS)) or ["another order"]
            raise InputError(f"appearance: expected the columns COLUMNS, got {wrong[0]} missing or more")
        lengths = {len(column) for column in self.columns.values()}
        if len(lengths) > 1:
            raise InputError(f"appearance: expected columns of one length, got lengths {sorted(lengths)}")

    @classmethod
    def neutral(cls, frames: int, **changed: int | float | Column) -> "Appearance":
        """What changes nothing but by the columns given, each one number for all frames or one a frame.

        Raises InputError for a column that there is not.
        """
        for name in changed:
            check_name("appearance", name, COLUMNS)
        values = _NEUTRAL | changed
        return cls({name: np.broadcast_to(np.asarray(values[name], float), frames) for name in COLUMNS})

    def __len__(self) -> int:
        return len(self.columns[SEED])

    def __getitem__(self, name: str) -> Column:
        return self.columns[name]


def draw_appearance(
    variation: AppearanceVariation, seed: Seed, numbers: Integer[np.ndarray, " frames"]
) -> Appearance:
    """What is done to the frames with these numbers; each depends on the seed and its number alone.

    Raises InputError for a negative seed or number.
    """
    values = uniforms(seed, numbers, 2 * len(COLUMNS))
    draws = Draws(COLUMNS, values[:, : len(COLUMNS)], values[:, len(COLUMNS) :], variation.share)
    columns: dict[str, Column] = {}
    for transform in TRANSFORMS:
        columns |= transform.draw(variation, draws)
    columns[SEED] = np.floor(2.0**32 * draws.share(SEED))
    return Appearance(columns)


def augment(images: Pictures, appearance: Appearance, cover: Pictures | None = None) -> Pictures:
    """The pictures with what `appearance` does to each.

    A frame depends on its picture and its row alone. Runs on one core; most of the time Python's lock is
    free, so that threads may work on different frames at once.

    images   (frames, height, width)  clean pictures, gray 0…255
    cover    (frames, height, width)  how much of each pixel the bodies cover, 0…255; if it is not given it
                                      is found from the pictures, at their edges to within a tenth
    returns  (frames, height, width)  gray 0…255

    Raises InputError if lengths differ, or where bodies are to be told from another background than the
    renderer's.
    """
    if images.ndim != 3 or images.dtype != np.uint8 or len(appearance) != len(images):
        raise InputError(
            f"images: expected uint8 (frames, height, width) with the appearance's {len(appearance)} frames, "
            f"got {images.dtype} {images.shape}"
        )
    if cover is not None and cover.shape != images.shape:
        raise InputError(f"cover: expected the shape of the images, {images.shape}, got {cover.shape}")
    _, height, width = images.shape
    matrices = homographies(appearance.columns, width, height)
    rows = np.stack(list(appearance.columns.values()), axis=-1).tolist()
    out = np.empty_like(images)
    for k, values in enumerate(rows):
        row = dict(zip(COLUMNS, values, strict=True))
        out[k] = _transformed(images[k], row, matrices[k], None if cover is None else cover[k])
    return out


def _transformed(
    picture: Picture, row: Row, homography: Float64[np.ndarray, "3 3"], cover: Picture | None
) -> Picture:
    acting = [each for each in TRANSFORMS if each.acts(row)]
    if cover is None and any(each.separates for each in acting):
        cover = coverage(picture)
    canvas = Canvas(picture, cover, homography, int(row[SEED]))
    for transform in acting:
        transform.apply(canvas, row)
    return canvas.picture


def coverage(picture: Picture) -> UInt8[np.ndarray, "height width"]:
    """How much of each pixel the bodies cover, 0…255, as far as a clean picture tells.

    A pixel at an edge shows cover · body + (1 − cover) · BACKGROUND; the body's gray is taken to be the
    darkest of its neighbours'. So does one in a gap so narrow that no pixel of it is background alone: it is
    lighter than a body of shade 0.7 and stands out from what is wider than two pixels around it.

    Raises InputError if less than a hundredth of the picture is BACKGROUND.
    """
    if np.count_nonzero(picture == BACKGROUND) < picture.size / 100:
        raise InputError(
            f"images: expected clean pictures with a background of {BACKGROUND}, got one without; "
            f"vary backgrounds, body_contrast and fingers_behind on pictures that were rendered without them"
        )
    around = np.ones((3, 3), np.uint8)
    cover = np.empty_like(picture)
    darkest = cv2.erode(picture, around)
    edges(picture, darkest, cv2.dilate(picture, around), cv2.dilate(darkest, around), _LIGHTEST, cover)
    return cover
