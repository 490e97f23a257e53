"""Pictures made what their appearance says: from another camera, before another background, hidden, noisy.

They start from the renderer's clean pictures, in which everything that is BACKGROUND is background. What a
pixel shows of the bodies is taken from there, so that any background can be put behind them.
"""

from typing import no_type_check

import cv2
import numpy as np
from jaxtyping import UInt8

from exosight.errors import InputError
from exosight.vision.appearance import BACKGROUND_KINDS, COLUMNS, OCCLUSION_KINDS, Appearance, to_table
from exosight.vision.background import background
from exosight.vision.compiling import compiled
from exosight.vision.corruptions import NOISE_MEAN
from exosight.vision.counter_rng import STEP, mix, normal_quantiles
from exosight.vision.lighting import FINGER_SHADE
from exosight.vision.occlusion import draw_fingers, occluder, put_before
from exosight.vision.renderer import BACKGROUND
from exosight.vision.view import homographies, seen

Pictures = UInt8[np.ndarray, "frames height width"]
Picture = UInt8[np.ndarray, "height width"]
Row = dict[str, float]

_VIEW = ("shift_x", "shift_y", "roll", "tilt_x", "tilt_y", "distortion")
_BEHIND, _BEFORE, _FRONT, _TEXTURE = (
    1,
    2,
    3,
    4,
)  # what a frame's seed is used for, each with numbers of its own


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
    matrices = homographies(appearance, width, height)
    rows = to_table(appearance).tolist()
    out = np.empty_like(images)
    for k, values in enumerate(rows):
        row = dict(zip(COLUMNS, values, strict=True))
        picture = _scene(images[k], row, matrices[k], None if cover is None else cover[k])
        picture = _lens(picture, row)
        _expose(picture, *_tone(row), normal_quantiles(), np.uint64(row["seed"]), out[k])
    return out


def coverage(picture: Picture) -> UInt8[np.ndarray, "height width"]:
    """How much of each pixel the bodies cover, 0…255, as far as a clean picture tells.

    A pixel at an edge shows cover · body + (1 − cover) · BACKGROUND; the body's gray is taken to be the
    darkest of its neighbours'. So does one in a gap so narrow that no pixel of it is background alone: it is
    lighter than any body of nominal shade and stands out from what is wider than two pixels around it.

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
    _coverage(picture, darkest, cv2.dilate(picture, around), cv2.dilate(darkest, around), cover)
    return cover


def _scene(picture: Picture, row: Row, matrix: np.ndarray, cover: Picture | None) -> Picture:
    """The bodies as another camera sees them, and what is behind and before them."""
    kind, objects, seed = int(row["background"]), int(row["occlusion"]), int(row["seed"])
    layered = kind or row["fingers_behind"] or row["body_range"]
    if layered and cover is None:
        cover = coverage(picture)
    if any(row[name] for name in _VIEW) or row["zoom"] != 1.0:
        height, width = picture.shape
        layers = (picture,) if cover is None else (picture, cover)
        shift = (row["shift_x"] * width, row["shift_y"] * height)
        picture, *rest = seen(layers, matrix, row["distortion"], shift)
        cover = rest[0] if rest else None
    # Before anything is drawn over the bodies: it tells where they are.
    mask = None
    if objects:
        name, place, angle = OCCLUSION_KINDS[objects - 1], row["occlusion_at"], row["occlusion_angle"]
        mask = occluder(name, picture, row["occluded"], place, angle, _own(seed, _BEFORE))
    if layered:
        assert cover is not None
        behind = np.full_like(picture, BACKGROUND)
        if kind:
            name, (height, width) = BACKGROUND_KINDS[kind - 1], picture.shape
            level, contrast = row["background_level"], row["background_contrast"]
            size, angle = row["background_size"], row["background_angle"]
            behind = background(name, (height, width), level, contrast, size, angle, _own(seed, _TEXTURE))
        draw_fingers(behind, int(row["fingers_behind"]), _own(seed, _BEHIND))
        composed = np.empty_like(picture)
        _compose(picture, cover, behind, row["body_dark"], 1.0 - row["body_range"], composed)
        picture = composed
    if row["fingers_in_front"]:
        picture = picture.copy()
        draw_fingers(picture, int(row["fingers_in_front"]), _own(seed, _FRONT))
    return picture if mask is None else put_before(picture, mask, row["occlusion_shade"])


def _lens(picture: Picture, row: Row) -> Picture:
    """Uneven light, then blur."""
    if row["gradient"] or row["vignette"]:
        lit = np.empty_like(picture)
        slope = (
            row["gradient"] * np.cos(row["gradient_angle"]),
            row["gradient"] * np.sin(row["gradient_angle"]),
        )
        _illuminate(picture, *slope, row["vignette"], lit)
        picture = lit
    if row["blur"]:
        picture = cv2.GaussianBlur(picture, (0, 0), row["blur"], borderType=cv2.BORDER_REFLECT)
    if row["motion"]:
        kernel = _streak(row["motion"], row["motion_angle"])
        picture = cv2.filter2D(picture, -1, kernel, borderType=cv2.BORDER_REFLECT)
    return picture


def _streak(length: float, angle: float) -> np.ndarray:
    """The kernel of a point that moves evenly along a line of this length [pixels]."""
    reach = int(np.ceil(length / 2)) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    steps = (np.arange(64) + 0.5) / 64 - 0.5
    x, y = reach + length * np.cos(angle) * steps, reach + length * np.sin(angle) * steps
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    right, down = x - column, y - row
    for across, along, weight in (
        (0, 0, (1 - right) * (1 - down)),
        (1, 0, right * (1 - down)),
        (0, 1, (1 - right) * down),
        (1, 1, right * down),
    ):
        np.add.at(kernel, (row + along, column + across), weight)
    return kernel / kernel.sum()


def _tone(row: Row) -> tuple[np.ndarray, np.ndarray, float]:
    """What each gray becomes, the standard deviation of its noise, and the noise's mean [gray levels]."""
    gray = np.arange(256) / 255
    tone = row["dark"] + (1 - row["range"]) * gray ** row["gamma"]
    spread = np.sqrt(row["noise"] + row["shot"] * tone)
    mean = 255 * NOISE_MEAN if row["noise"] else 0.0
    return (255 * tone).astype(np.float32), (255 * spread).astype(np.float32), mean


def _own(seed: int, purpose: int) -> int:
    """A seed for one purpose of a frame."""
    return seed + (purpose << 32)


@compiled
@no_type_check
def _coverage(picture, darkest, lightest, opened, cover):
    for i in range(picture.shape[0]):
        for j in range(picture.shape[1]):
            gap = picture[i, j] > 255.0 * FINGER_SHADE + 5.0 and picture[i, j] > opened[i, j] + 30.0
            if picture[i, j] >= BACKGROUND:
                cover[i, j] = 0
            elif lightest[i, j] < BACKGROUND and not gap:
                cover[i, j] = 255
            else:
                share = (BACKGROUND - picture[i, j]) / (BACKGROUND - darkest[i, j])
                cover[i, j] = int(255.0 * share + 0.5)


@compiled
@no_type_check
def _compose(picture, cover, behind, dark, contrast, out):
    """The bodies, their grays moved into a range, before another background."""
    for i in range(picture.shape[0]):
        for j in range(picture.shape[1]):
            c = np.float32(cover[i, j]) / np.float32(255)
            through = np.float32(1) - c
            bodies = max(picture[i, j] - through * np.float32(BACKGROUND), np.float32(0))
            value = np.float32(contrast) * bodies + np.float32(255 * dark) * c + through * behind[i, j]
            out[i, j] = np.uint8(min(value + np.float32(0.5), np.float32(255)))


@compiled
@no_type_check
def _illuminate(picture, slope_x, slope_y, vignette, out):
    """Brightness that changes across the picture, and falls towards its corners."""
    height, width = picture.shape
    corner = np.sqrt(width * width + height * height) / 2.0
    for i in range(height):
        y = np.float32((i + 0.5 - height / 2.0) / corner)
        row = np.float32(1.0 + slope_y * y - vignette * y * y)
        for j in range(width):
            x = np.float32((j + 0.5 - width / 2.0) / corner)
            gain = row + np.float32(slope_x) * x - np.float32(vignette) * x * x
            out[i, j] = np.uint8(
                min(max(picture[i, j] * gain + np.float32(0.5), np.float32(0)), np.float32(255))
            )


@compiled
@no_type_check
def _expose(picture, tone, spread, mean, quantiles, seed, out):
    """What each gray becomes, with noise: four normal numbers from each 64 random bits."""
    height, width = picture.shape
    if mean == 0.0 and spread.max() == 0.0:
        for i in range(height):
            for j in range(width):
                out[i, j] = np.uint8(tone[picture[i, j]] + np.float32(0.5))
        return
    state, bits = mix(seed + STEP), np.uint64(0)
    for i in range(height):
        for j in range(width):
            if (i * width + j) % 4 == 0:
                state += STEP
                bits = mix(state)
            gray = picture[i, j]
            value = tone[gray] + np.float32(mean) + spread[gray] * quantiles[bits & np.uint64(65535)]
            bits >>= np.uint64(16)
            out[i, j] = np.uint8(min(max(value, np.float32(0)), np.float32(255)) + np.float32(0.5))
