"""Pictures that no estimator of contact forces should trust: what to test its doubt with."""

from collections.abc import Callable

import cv2
import numpy as np
from jaxtyping import Int, UInt8

from exosight.errors import InputError
from exosight.system.camera import Camera
from exosight.validation import check_name
from exosight.vision.appearance import AppearanceVariation
from exosight.vision.background import HELD_OUT_BACKGROUNDS
from exosight.vision.occlusion import HELD_OUT_OCCLUSIONS
from exosight.vision.renderer import BACKGROUND, Tube, render

HELD_OUT: dict[str, AppearanceVariation] = {
    "backgrounds": AppearanceVariation(backgrounds=HELD_OUT_BACKGROUNDS),
    "occlusions": AppearanceVariation(occlusions=HELD_OUT_OCCLUSIONS, occluded=(0.05, 0.25)),
}
"""What may happen to pictures of the plant and is not trained with: see `draw_appearance` and `augment`."""

Picture = UInt8[np.ndarray, "height width"]


def draw_ood_images(
    kind: str, count: int, seed: int, width: int = 128, height: int = 128
) -> UInt8[np.ndarray, "count height width"]:
    """Pictures without the plant; each depends on the seed and its place alone.

    kind           one of OOD_KINDS
    width, height  [pixels]
    returns        (count, height, width)  gray 0…255

    Raises InputError for an unknown kind, a negative count or seed, or a side below 16 pixels.
    """
    check_name("kind", kind, OOD_KINDS)
    if count < 0 or seed < 0 or min(width, height) < 16:
        raise InputError(
            f"images: expected a count and a seed from 0 and sides from 16 pixels, "
            f"got {count}, {seed} and {width}×{height}"
        )
    images = np.empty((count, height, width), np.uint8)
    for k in range(count):
        images[k] = OOD_KINDS[kind](np.random.default_rng([seed, k]), width, height)
    return images


def _plain(rng: np.random.Generator, width: int, height: int) -> Picture:
    """Nothing but a background, evenly or unevenly lit."""
    corners = np.clip(rng.uniform(0, 255) + rng.uniform(-60, 60, (2, 2)), 0, 255).astype(np.float32)
    return np.rint(cv2.resize(corners, (width, height))).astype(np.uint8)


def _speckle(rng: np.random.Generator, width: int, height: int) -> Picture:
    """White noise."""
    return rng.integers(0, 256, (height, width), dtype=np.uint8)


def _clouds(rng: np.random.Generator, width: int, height: int) -> Picture:
    """Noise with the spectrum of natural pictures: amplitude as one over frequency, roughly."""
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None])
    frequency[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.standard_normal((height, width))) / frequency ** rng.uniform(0.8, 1.6)
    field = np.fft.irfft2(spectrum, (height, width))
    return np.clip(127 + rng.uniform(30, 70) * field / field.std(), 0, 255).astype(np.uint8)


def _shapes(rng: np.random.Generator, width: int, height: int) -> Picture:
    """Discs, triangles and lines over each other."""
    picture = np.full((height, width), int(rng.integers(256)), np.uint8)
    for _ in range(rng.integers(4, 15)):
        corners = _points(rng, 3, width, height)
        gray, size = int(rng.integers(256)), int(rng.integers(3, max(width // 4, 4)))
        match rng.integers(3):
            case 0:
                cv2.circle(picture, corners[0].tolist(), size, gray, -1, cv2.LINE_AA)
            case 1:
                cv2.fillPoly(picture, [corners], gray, cv2.LINE_AA)
            case _:
                cv2.line(picture, corners[0].tolist(), corners[1].tolist(), gray, 1 + size // 4, cv2.LINE_AA)
    return picture


def _text(rng: np.random.Generator, width: int, height: int) -> Picture:
    """Lines of letters and digits, dark on light or light on dark."""
    ink, paper = (int(each) for each in rng.choice([(20, 230), (230, 20), (90, 200)]))
    picture = np.full((height, width), paper, np.uint8)
    size = rng.uniform(0.3, 0.9)
    for line in np.arange(20 * size, height + 20 * size, 30 * size):
        words = "".join(rng.choice(list("abcdefghijkmnopqrstuvwxyz0123456789   "), 40))
        cv2.putText(
            picture, words, (2, int(line)), cv2.FONT_HERSHEY_SIMPLEX, float(size), ink, 1, cv2.LINE_AA
        )
    return picture


def _room(rng: np.random.Generator, width: int, height: int) -> Picture:
    """A table with boxes on it, before a wall."""
    wall, table = rng.uniform(60, 240, 2)
    picture = np.full((height, width), wall, np.float32)
    horizon = int(rng.uniform(0.3, 0.7) * height)
    picture[horizon:] = table * np.linspace(0.7, 1.0, height - horizon)[:, None]
    for _ in range(rng.integers(2, 7)):
        left, right = np.sort(rng.integers(0, width, 2))
        bottom = int(rng.uniform(horizon / height, 1) * height)
        top = int(bottom - rng.uniform(0.1, 0.5) * height)
        picture[max(top, 0) : bottom, left:right] = rng.uniform(10, 250)
        picture[max(top, 0) : bottom, (left + right) // 2 : right] *= (
            0.7  # the side that turns from the light
        )
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.6), 0, 255).astype(np.uint8)


def _tangle(rng: np.random.Generator, width: int, height: int) -> Picture:
    """Tubes such as those of the plant, as dark and as light, lying anywhere."""
    camera = Camera(centre=(0.0, 0.0), metres_per_pixel=1 / width, width=width, height=height)
    tubes = []
    for _ in range(rng.integers(1, 5)):
        heading = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.normal(0, 0.35, 12))
        nodes = np.zeros((1, 13, 3))
        nodes[0, :, ::2] = rng.uniform(-0.4, 0.4, 2)
        nodes[0, 1:, ::2] += np.cumsum(0.055 * np.stack([np.cos(heading), np.sin(heading)], axis=-1), axis=0)
        radii = np.linspace(rng.uniform(0.025, 0.08), rng.uniform(0.025, 0.08), 13)[None]
        tubes.append(Tube(nodes, radii, float(rng.uniform(0.2, 0.8))))
    return render(tubes, camera, visibility="stacked")[0]


def _bare(rng: np.random.Generator, width: int, height: int) -> Picture:
    """The renderer's background alone, with a speck: the plant has left the picture."""
    picture = np.full((height, width), BACKGROUND, np.uint8)
    cv2.circle(picture, _points(rng, 1, width, height)[0].tolist(), int(rng.integers(1, 6)), 120, -1)
    return picture


def _points(rng: np.random.Generator, count: int, width: int, height: int) -> Int[np.ndarray, "count 2"]:
    return rng.integers(0, (width, height), (count, 2), dtype=np.int32)


OOD_KINDS: dict[str, Callable[[np.random.Generator, int, int], Picture]] = {
    "plain": _plain,
    "bare": _bare,
    "speckle": _speckle,
    "clouds": _clouds,
    "shapes": _shapes,
    "text": _text,
    "room": _room,
    "tangle": _tangle,
}
"""Kinds of picture without the plant."""
