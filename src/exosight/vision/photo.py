"""Pictures as a camera takes them: textured bodies, held by a hand and a mount, before a desk, in real light.

Everything that a photograph may differ in is drawn frame by frame, so that a network which learns from such
pictures relies on none of it: a pinhole camera that is moved and tilted; skin, rings and patterns on the
bodies; a hand, other fingers, blocks and straps at the base of each; walls, desks and clutter behind them;
a lamp with cast shadows, diffuse light and highlights; cables and objects in front; exposure, gray value
curve, blur, noise and JPEG. Light adds up in linear shares,

    gray = exposure · (albedo · (ambient + key · max(n·l, 0) · (1 − shadow)) + specular · max(n·h, 0)ᵖ),

the model of Phong, doi 10.1145/360825.360839, with the half vector h of Blinn, doi 10.1145/563858.563893.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int64, UInt8

from exosight.system.camera import Camera, project_spheres
from exosight.vision.appearance import AppearanceVariation
from exosight.vision.augment import augment, draw_appearance
from exosight.vision.background import BACKGROUNDS
from exosight.vision.clutter import backdrop, cable_mask, cover_with, moved, texture
from exosight.vision.depth_order import draw_in_depth_order
from exosight.vision.holders import Piece, blocks, holders
from exosight.vision.occlusion import OCCLUSIONS
from exosight.vision.renderer import Tube

Rng = np.random.Generator
Plane = Float32[np.ndarray, "height width"]
Mask = UInt8[np.ndarray, "height width"]

CLEAN = 0.25
"""Share of the frames that stay as the renderer draws them: clean pictures are still to be read, and
causes of unusual images are fitted on them."""
TILT, SHIFT, ROLL, ZOOM = 0.16, 0.035, 0.1, 0.1
"""Largest tilt each way [rad], shift [picture widths], roll [rad], enlargement [-]."""
DISTANCE = 0.25, 1.5
"""Limits of the camera's distance [m]."""
DISTORTION = 0.04
"""Largest radial distortion at the picture's corners, as a share of their distance."""
GAP = 0.006, 0.12
"""Limits of the distance from the bodies to what lies behind them [m]."""
EXPOSURE, GAMMA = (0.5, 1.3), (1.0, 2.4)
"""Limits of what the 95 % quantile of light becomes, where white is 1, and of the gray value curve."""

LENS_AND_SENSOR = AppearanceVariation(
    share=0.4,
    occlusions=OCCLUSIONS,
    occluded=(0.004, 0.03),
    gradient=0.4,
    vignette=0.4,
    blur=1.2,
    motion=5.0,
    contrast=0.6,
    noise=0.0015,
    shot=0.003,
)
"""What becomes of the finished scene; the noise that a network sees beyond it is that of its recipe."""


def photo(
    tubes: Sequence[Tube],
    camera: Camera,
    images: UInt8[np.ndarray, "frames height width"],
    seed: tuple[int, ...],
    numbers: Int64[np.ndarray, " frames"],
) -> UInt8[np.ndarray, "frames height width"]:
    """Photo-like pictures of a device; a frame depends on its pose, the seed and its number alone.

    tubes    bodies, the first of them held by a hand, the others by mounts
    camera   near which every frame has a camera of its own
    images   the clean pictures of the same frames
    numbers  of the frames, from 0

    Runs on one core.
    """
    found = np.array(images)
    chosen = []
    for k, number in enumerate(numbers.tolist()):
        rng = np.random.default_rng([*seed, number])
        if rng.random() >= CLEAN:
            pieces = [Piece(tube.centres[k], tube.radii[k]) for tube in tubes]
            found[k] = _scene(rng, pieces, _camera(rng, camera))
            chosen.append(k)
    finished = draw_appearance(LENS_AND_SENSOR, seed, numbers[chosen])
    found[chosen] = augment(found[chosen], finished)
    for k in chosen:
        rng = np.random.default_rng([*seed, int(numbers[k]), 1])
        if rng.random() < 0.5:
            quality = int(rng.integers(25, 96))
            _, data = cv2.imencode(".jpg", found[k], [cv2.IMWRITE_JPEG_QUALITY, quality])
            found[k] = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
    return found


def _camera(rng: Rng, camera: Camera) -> Camera:
    """A pinhole camera near an orthographic one, which shows about the same field."""
    right, up, roll, pan, tilt, lens, zoom = rng.uniform(-1, 1, 7)
    side = camera.width * camera.metres_per_pixel
    return replace(
        camera,
        centre=(camera.centre[0] + SHIFT * side * right, camera.centre[1] + SHIFT * side * up),
        metres_per_pixel=camera.metres_per_pixel * (1 + ZOOM) ** -zoom,
        roll=camera.roll + ROLL * roll,
        distance=float(np.exp(rng.uniform(*np.log(DISTANCE)))),
        pan=TILT * pan,
        tilt=TILT * tilt,
        distortion=DISTORTION * lens,
    )


class _Light(NamedTuple):
    """What a scene is lit by."""

    lamp: Float[np.ndarray, "3"]
    """unit vector to it: right, up, towards the camera"""
    key: float
    """its light on a surface that faces it"""
    ambient: float
    """light from all sides"""
    strength: np.float32
    """share of the lamp's light that a shadow lacks"""

    @property
    def shift(self) -> tuple[float, float]:
        """Where a shadow falls, to the right and down, at a unit distance behind what casts it."""
        across, up = self.lamp[:2] / max(self.lamp[2], 0.35)
        return -across, up


def _scene(rng: Rng, bodies: list[Piece], camera: Camera) -> UInt8[np.ndarray, "height width"]:
    held = [holders(rng, body, hand=k == 0) for k, body in enumerate(bodies)]
    drawn = _Drawn(bodies + [piece for pieces in held for piece in pieces], camera)
    lamp = _direction(rng, 1.1)
    surface = np.asarray(backdrop(rng, (camera.height, camera.width)), np.float32)
    behind, before = blocks(rng, bodies, camera)
    for mask, shade in behind:
        cover_with(surface, mask, shade)
    cover = drawn.layer()
    scene, light = _behind(rng, surface, cover, lamp, camera.metres_per_pixel)
    scene *= 1 - cover.astype(np.float32) / 255
    scene += _bodies(rng, drawn, cover, [len(pieces) for pieces in held], light)
    _in_front(rng, scene, before, np.float32(light.ambient + 0.7 * light.key))
    # From dark to overexposed: what the 95 % quantile of light becomes, and the gray value curve.
    gain = np.exp(rng.uniform(*np.log(EXPOSURE))) / np.quantile(scene[::4, ::4], 0.95)
    curve = np.float32(1 / rng.uniform(*GAMMA))
    return (255 * np.clip(scene * np.float32(gain), 0, 1) ** curve + 0.5).astype(np.uint8)


def _behind(
    rng: Rng, surface: Plane, cover: Mask, lamp: Float[np.ndarray, "3"], metres_per_pixel: float
) -> tuple[Plane, _Light]:
    """A surface in the shadows of what is before it, some distance away, and the light of the scene."""
    gap = np.exp(rng.uniform(*np.log(GAP))) / metres_per_pixel
    softness = gap * rng.uniform(0.05, 0.5)
    key, ambient = rng.uniform(0.2, 1.0), rng.uniform(0.15, 0.6)
    dark = np.float32(rng.uniform(0, 0.6) / 255) * moved(cover, 0.0, 0.0, rng.uniform(1.0, 6.0))
    light = _Light(lamp, key, ambient, np.float32(rng.uniform(0.3, 1.0)))
    right, down = light.shift
    shadow = light.strength / 255 * moved(cover, right * gap, down * gap, softness)
    lit = ambient * (1 - dark) + key * max(lamp[2], 0.2) * (1 - shadow)
    return surface * lit.astype(np.float32), light


def _bodies(rng: Rng, drawn: "_Drawn", cover: Mask, held: list[int], light: _Light) -> Plane:
    """Bodies and what holds them, lit, times the share of each pixel that they cover."""
    albedo = _reflectance(rng, drawn, held).astype(np.float32) / 255
    own = [drawn.layer([float(k == i) for k in range(drawn.count)]) for i in range(1, len(held))]
    # What holds the first body is of one kind with it.
    own.insert(0, cover - np.minimum(np.sum(own, axis=0, dtype=np.uint16), cover).astype(np.uint8))
    lit, open_to_sky = np.ones(cover.shape, np.float32), np.ones(cover.shape, np.float32)
    right, down = light.shift
    for mask in own:
        if rng.random() < 0.7:
            kinds = BACKGROUNDS if rng.random() < 0.5 else ("fractal", "smooth")
            albedo *= 1 + texture(rng, cover.shape, kinds, 0.5) * (mask.astype(np.float32) / 255)
        # What a body takes of the light that falls on the others; both masks are 0…255.
        others = (cover.astype(np.float32) - mask) / 255
        reach = rng.uniform(2.0, 9.0)
        cast = moved(mask, right * reach, down * reach, rng.uniform(0.4, 2.5))
        lit -= light.strength / 255 * cast * others
        near = np.float32(rng.uniform(0, 0.7) / 255)
        open_to_sky -= near * moved(mask, 0.0, 0.0, rng.uniform(0.8, 3.0)) * others
    np.maximum(lit, 0, out=lit)
    np.maximum(open_to_sky, 0, out=open_to_sky)
    ones, part = [1.0] * drawn.count, np.maximum(cover.astype(np.float32), 1)
    half = light.lamp + [0.0, 0.0, 1.0]  # noqa: RUF005 (vectors are added)
    lambert = drawn.layer(ones, light.lamp) / part
    shine = drawn.layer(ones, half / np.linalg.norm(half)) / part
    power, gloss = np.exp(rng.uniform(np.log(4), np.log(60))), max(rng.uniform(-0.4, 0.5), 0.0)
    diffuse = light.ambient * (0.4 + 0.6 * shine) * open_to_sky + light.key * lambert * lit
    specular = gloss * light.key * np.minimum(shine, 1) ** power * lit * part / 255
    return (albedo * diffuse + specular).astype(np.float32)


def _in_front(rng: Rng, scene: Plane, before: list[tuple[Mask, np.ndarray]], lit: np.float32) -> None:
    """Blocks and cables before everything else, in place."""
    for mask, shade in before:
        cover_with(scene, mask, lit * shade)
    for _ in range(rng.choice([0, 1, 2], p=[0.7, 0.22, 0.08])):
        mask, bright = cable_mask(rng, scene.shape, rng.uniform(0.008, 0.03) * scene.shape[1])
        cover_with(scene, mask, lit * np.float32(rng.uniform(0.02, 0.9)) * bright)


def _reflectance(rng: Rng, drawn: "_Drawn", held: list[int]) -> UInt8[np.ndarray, "height width"]:
    """Reflectances 0…1 of the bodies, with rings on one of them now and then, and of what holds each."""
    own = rng.uniform(0.04, 0.95, len(held)).tolist()
    shades = list(own)
    for shade, count in zip(own, held, strict=True):
        skin = rng.random() < 0.6  # a hand is like its finger
        shades += [shade] * count if skin else rng.uniform(0.04, 0.95, count).tolist()
    number = int(rng.integers(len(held)))
    segments = drawn.sizes[number] - 1
    if segments < 8 or rng.random() < 0.5:
        return drawn.layer(shades)
    place = np.arange(segments) / segments
    wave = np.sin(2 * np.pi * (rng.uniform(1, 14) * place + rng.random()))
    rings = np.sign(wave) if rng.random() < 0.5 else wave
    values = np.clip(
        shades[number] * (1 + rng.uniform(0, 0.6) * rings) + rng.uniform(-0.2, 0.2) * place, 0, 1
    )
    return drawn.ringed(number, values, shades)


def _direction(rng: Rng, largest: float) -> Float[np.ndarray, "3"]:
    """A unit vector (right, up, towards the camera), even over the cap around (0, 0.4, 0.9) or so."""
    across, turn = largest * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
    aim = np.array([np.sin(across) * np.cos(turn), np.sin(across) * np.sin(turn) + 0.35, np.cos(across)])
    aim[2] = max(aim[2], 0.15)
    return aim / np.linalg.norm(aim)


class _Drawn:
    """Tubes of one frame in the picture, to be drawn in any shades and light."""

    def __init__(self, pieces: list[Piece], camera: Camera) -> None:
        projected = [project_spheres(camera, piece.centres, piece.radii) for piece in pieces]
        self._nodes = np.concatenate([nodes for nodes, _ in projected])[None]
        # Depth along y, not along the view: a tilt moves neighbours alike, and axes in one plane draw faster.
        depth = np.concatenate([piece.centres[:, 1] for piece in pieces])
        self._nodes[0, :, 2] = depth / camera.metres_per_pixel
        self._radii = np.concatenate([radii for _, radii in projected])[None]
        self._ends = np.cumsum([0, *(len(piece.radii) for piece in pieces)])
        self._shape = 1, camera.height, camera.width
        self.count = len(pieces)
        self.sizes = np.diff(self._ends)

    def layer(
        self, shades: Sequence[float] | None = None, lamp: Float[np.ndarray, "3"] | None = None
    ) -> UInt8[np.ndarray, "height width"]:
        """Before black: the shades as they are, or by max(n·l, 0) under a lamp; without shades, the cover."""
        image = np.zeros(self._shape, np.uint8)
        values = np.ones((1, self.count)) if shades is None else np.array([shades], float)
        ambient = np.array([1.0 if lamp is None else 0.0])
        direction = np.array([[0.0, 0.0, 1.0] if lamp is None else lamp], float)
        draw_in_depth_order(image, self._nodes, self._radii, self._ends, values, direction, ambient)
        return image[0]

    def ringed(
        self, number: int, shades: Float[np.ndarray, " segments"], others: Sequence[float]
    ) -> UInt8[np.ndarray, "height width"]:
        """The shades as they are, those of one tube segment by segment."""
        image = np.zeros(self._shape, np.uint8)
        start, stop = self._ends[number], self._ends[number + 1]
        picks = np.r_[:start, np.repeat(np.arange(start, stop), 2)[1:-1], stop : self._ends[-1]]
        ends = np.r_[self._ends[:number], np.arange(start, start + 2 * (stop - start) - 1, 2)]
        ends = np.r_[ends, self._ends[number + 2 :] + (stop - start - 2)]
        values = np.array([[*others[:number], *shades, *others[number + 1 :]]], float)
        draw_in_depth_order(
            image,
            np.ascontiguousarray(self._nodes[:, picks]),
            np.ascontiguousarray(self._radii[:, picks]),
            ends,
            values,
            np.array([[0.0, 0.0, 1.0]]),
            np.ones(1),
        )
        return image[0]
