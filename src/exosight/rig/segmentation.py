"""Masks of the bodies in pictures, from a picture of the empty scene, from their colours, or from both.

A round body under one light shows its colour c in many brightnesses, p = s c with s from DARKEST to 1, so the
distance of a pixel from this line of colours says how well it fits the body. What differs from the empty
scene, or without one what fits a body, is foreground; pixels that fit one body clearly are flooded from, up
to edges, so that each pixel of the foreground gets the body that it is connected with. Foreground that fits
none, a hand or a mount, is not known.
"""

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy import ndimage

from exosight.errors import DataError, InputError
from exosight.rig.identification.outlines import UNKNOWN

Colour = tuple[int, int, int]
"""Red, green and blue of a body's brightest place, 0…255."""
DARKEST = 0.35
"""Brightness of a body's darkest place over that of its brightest; the renderer's ambient light is 0.4."""
LEAST = 12.0
"""Grays that foreground differs from the empty scene by at least; JPEG and flicker stay below."""
NOISES = 5.0
"""Deviations of the noise that it differs by at least."""
FIT = 24.0
"""Grays by which a pixel may differ from a body's colours: texture, highlights, and colour of the light."""
CLEAR = 10.0
"""Grays by which it is nearer to one body's colours than to those of others where that body is certain."""
PIECE = 0.1
"""Share of a body's largest piece below which a piece is a speck."""


@dataclass(frozen=True)
class Segmented:
    """Bodies in a picture.

    mask     0 background, 1 the first body, 2 the second …, 255 not known
    scores   (bodies,)  quality of each: the share of its pixels that fit its colours, times that which is in
             one piece, times that of its border where the picture has an edge; 0 without the body
    """

    mask: UInt8[np.ndarray, "rows columns"]
    scores: Float[np.ndarray, " bodies"]


def segment(
    picture: UInt8[np.ndarray, "rows columns 3"],
    colours: Float[np.ndarray, "bodies 3"],
    empty: UInt8[np.ndarray, "_ _ 3"] | None,
    name: str = "picture",
) -> Segmented:
    """The masks of bodies of these colours in a picture of red, green and blue.

    colours   of each body's brightest place, 0…255
    empty     the scene without the device, from the same camera

    Raises DataError, beginning with `name`, if the empty scene has another size, and InputError for two
    bodies of one colour.
    """
    seen = cv2.GaussianBlur(picture, (0, 0), 0.7).astype(np.float32)
    away = np.stack([_from_line(seen, colour.astype(np.float32)) for colour in colours])
    for i, colour in enumerate(colours):
        for j in range(i):
            pair = _from_line(colour, colours[j]), _from_line(colours[j], colour)
            if max(map(float, pair)) < CLEAR:
                raise InputError(
                    f"colours: expected bodies that differ, got {_text(colours[j])} and {_text(colour)}; "
                    "paint one, or draw masks yourself"
                )
    nearest = away.min(axis=0)
    device = nearest < FIT
    different, change = device, np.where(device, 1.0, 0.0)
    if empty is not None:
        if empty.shape != picture.shape:
            raise DataError(
                f"{name}: expected {empty.shape[1]}×{empty.shape[0]} pixels, as the empty scene has, got "
                f"{picture.shape[1]}×{picture.shape[0]}; take both by one camera"
            )
        scene = cv2.GaussianBlur(empty, (0, 0), 0.7).astype(np.float32)
        different, change = _different(seen, scene, nearest)
    foreground = np.asarray(ndimage.binary_opening(different, np.ones((3, 3), bool)), bool)
    known = foreground & device
    labels = _flooded(picture, known, away)
    mask, scores = np.zeros(picture.shape[:2], np.uint8), []
    mask[_thick(foreground & ~known)] = UNKNOWN
    edges = _edges(seen)
    for body in range(len(colours)):
        own = labels == body + 1
        whole, share = _pieces(own)
        mask[_thick(own & ~whole)] = UNKNOWN
        mask[whole] = body + 1
        scores.append(share * _fitting(away, body, whole) * _bordered(whole, edges))
    return Segmented(_to_half(mask, change), np.array(scores))


def _thick(own: Bool[np.ndarray, "rows columns"]) -> Bool[np.ndarray, "rows columns"]:
    """What is wider than the mixed colours along an edge."""
    return np.asarray(ndimage.binary_opening(own, np.ones((5, 5), bool)), bool)


def _to_half(
    mask: UInt8[np.ndarray, "rows columns"], change: Float[np.ndarray, "rows columns"]
) -> UInt8[np.ndarray, "rows columns"]:
    """The mask with bodies up to where half of their change from the empty scene is left, within 2 pixels."""
    bodies = (mask > 0) & (mask != UNKNOWN)
    core = np.asarray(ndimage.binary_erosion(bodies, np.ones((3, 3), bool), border_value=1), bool)
    if not core.any():
        return mask
    # Without an array to write to it returns both.
    depth, at = cast(
        tuple[np.ndarray, np.ndarray], ndimage.distance_transform_edt(~core, return_indices=True)
    )
    rim = (depth > 0) & (depth < 3) & (mask != UNKNOWN)
    half = change > 0.5 * change[at[0], at[1]]
    return np.where(rim, np.where(half, np.where(bodies, mask, mask[at[0], at[1]]), 0), mask).astype(np.uint8)


def _from_line(seen: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """Distance of pixels from the shades of a colour, root mean square of the channels [grays]."""
    share = np.sum(seen * colour, axis=-1) / np.maximum(np.sum(colour * colour, axis=-1), 1.0)
    return np.asarray(
        np.sqrt(np.mean((seen - np.clip(share, DARKEST, 1.0)[..., None] * colour) ** 2, axis=-1))
    )


def _different(
    seen: np.ndarray, empty: np.ndarray, nearest: np.ndarray
) -> tuple[Bool[np.ndarray, "rows columns"], Float[np.ndarray, "rows columns"]]:
    """Where a picture differs from the empty scene, and by how much [grays].

    Exposure and white balance may be others. What is the scene in shade, and fits no body as well, is a
    shadow.

    nearest   distance of each pixel from the colours of the body that it fits best
    """
    gain = np.median((seen + 1) / (empty + 1), axis=(0, 1))
    away = np.sqrt(np.mean((seen - gain * empty) ** 2, axis=-1))
    shade = _from_line(seen, gain * empty)
    shadow = (shade < LEAST) & (shade + CLEAR / 2 < nearest)
    return (away > max(LEAST, NOISES * 1.4826 * float(np.median(away)))) & ~shadow, away


def _flooded(
    picture: UInt8[np.ndarray, "rows columns 3"],
    known: Bool[np.ndarray, "rows columns"],
    away: Float[np.ndarray, "bodies rows columns"],
) -> Int[np.ndarray, "rows columns"]:
    """0 where no body is, else the number of the body from 1: flooded from where one is certain."""
    markers = np.where(known, 0, len(away) + 1).astype(np.int32)
    second = np.partition(away, 1, axis=0)[1] if len(away) > 1 else np.full(known.shape, np.inf)
    certain = known & (second - away.min(axis=0) > CLEAR)
    markers[certain] = away.argmin(axis=0)[certain] + 1
    if not certain.any():
        return np.zeros(known.shape, int)
    gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    steep = np.where(known, ndimage.morphological_gradient(gray, size=(3, 3)), 255).astype(np.uint8)
    flooded = np.asarray(ndimage.watershed_ift(steep, markers)).astype(int)
    return np.where(known & (flooded <= len(away)), flooded, 0)


def _pieces(own: Bool[np.ndarray, "rows columns"]) -> tuple[Bool[np.ndarray, "rows columns"], float]:
    """A body without its specks and holes, and the share of the largest piece."""
    parts = np.zeros(own.shape, np.int32)
    count = ndimage.label(own, output=parts)
    if not count:
        return own, 0.0
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    whole = own & (sizes[parts] >= PIECE * sizes.max())
    return whole, float(sizes.max() / sizes.sum())


def _fitting(away: Float[np.ndarray, "bodies rows columns"], body: int, own: np.ndarray) -> float:
    """Share of a body's pixels that fit it, of all bodies, best."""
    return float(np.mean(away.argmin(axis=0)[own] == body)) if own.any() else 0.0


def _edges(seen: np.ndarray) -> Bool[np.ndarray, "rows columns"]:
    """Where the picture has an edge within a pixel: a step of LEAST grays over three pixels."""
    step = [ndimage.sobel(seen, axis=axis) / 4 for axis in (0, 1)]
    return cv2.dilate((np.hypot(*step).max(axis=-1) > LEAST).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0


def _bordered(own: Bool[np.ndarray, "rows columns"], edges: Bool[np.ndarray, "rows columns"]) -> float:
    """Share of a body's border, but for that of the picture, on which there is an edge."""
    inner = np.asarray(ndimage.binary_erosion(own, border_value=1), bool)
    border = own & ~inner
    return float(edges[border].mean()) if border.any() else 0.0


def _text(colour: Float[np.ndarray, "3"]) -> str:
    return ",".join(f"{value:.0f}" for value in colour)
