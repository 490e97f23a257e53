"""Pictures as a camera takes them: of textured bodies, held by a hand and a mount, before a desk, in real light.

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

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int64, UInt8

from exosight.system.camera import Camera, project_spheres
from exosight.vision.appearance import AppearanceVariation
from exosight.vision.augment import augment, draw_appearance
from exosight.vision.background import BACKGROUNDS
from exosight.vision.clutter import backdrop, cable_mask, cover_with, moved, polygon_mask, texture
from exosight.vision.depth_order import draw_in_depth_order
from exosight.vision.holders import Piece, blocks, holders
from exosight.vision.occlusion import OCCLUSIONS
from exosight.vision.renderer import Tube

Rng = np.random.Generator
Plane = Float32[np.ndarray, "height width"]

CLEAN = 0.1
"""Share of the frames that stay as the renderer draws them, so that clean pictures are still read."""
TILT, SHIFT, ROLL, ZOOM = 0.16, 0.035, 0.1, 0.1
"""Largest tilt each way [rad], shift [picture widths], roll [rad], enlargement [-]."""
DISTANCE = 0.25, 1.5
"""Limits of the camera's distance [m]."""
DISTORTION = 0.04
"""Largest radial distortion at the picture's corners, as a share of their distance."""

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


def _scene(rng: Rng, bodies: list[Piece], camera: Camera) -> UInt8[np.ndarray, "height width"]:
    shape = camera.height, camera.width
    held = [holders(rng, body, hand=k == 0) for k, body in enumerate(bodies)]
    drawn = _Drawn(bodies + [piece for pieces in held for piece in pieces], camera)
    lamp = _direction(rng, 1.1)
    away = lamp[:2] / max(lamp[2], 0.35)
    # The lamp's cast shadow on what lies behind, and the darkness of diffuse light next to a body.
    scene = np.asarray(backdrop(rng, shape), np.float32)
    behind, before = blocks(rng, bodies, camera)
    for mask, shade in behind:
        cover_with(scene, mask, shade)
    cover = drawn.layer()
    gap = np.exp(rng.uniform(np.log(0.006), np.log(0.12))) / camera.metres_per_pixel
    softness = gap * rng.uniform(0.05, 0.5)
    key, ambient = rng.uniform(0.2, 1.0), rng.uniform(0.15, 0.6)
    shadow = np.float32(1 / 255) * moved(cover, -away[0] * gap, away[1] * gap, softness)
    near = np.float32(rng.uniform(0, 0.6) / 255) * moved(cover, 0, 0, rng.uniform(1.0, 6.0))
    strength = np.float32(rng.uniform(0.3, 1.0))
    scene *= (ambient * (1 - near) + key * max(lamp[2], 0.2) * (1 - strength * shadow)).astype(np.float32)

    albedo = _reflectance(rng, drawn, [len(pieces) for pieces in held]).astype(np.float32) / 255
    own = [drawn.layer([float(k == i) for k in range(drawn.count)]) for i in range(1, len(bodies))]
    own.insert(0, cover - np.minimum(np.sum(own, axis=0, dtype=np.uint16), cover).astype(np.uint8))
    lit_share = np.ones(shape, np.float32)
    dark = np.ones(shape, np.float32)
    for mask in own:
        if rng.random() < 0.7:
            kinds = BACKGROUNDS if rng.random() < 0.5 else ("fractal", "smooth")
            albedo *= 1 + texture(rng, shape, kinds, 0.5) * (mask.astype(np.float32) / 255)
        # What a body takes of the light that falls on the others; both masks are 0…255.
        others = (cover.astype(np.float32) - mask) / 255
        reach = rng.uniform(2.0, 9.0)
        cast = moved(mask, -away[0] * reach, away[1] * reach, rng.uniform(0.4, 2.5)).astype(np.float32)
        lit_share -= strength * cast / 255 * others
        dark -= np.float32(rng.uniform(0, 0.7) / 255) * moved(mask, 0, 0, rng.uniform(0.8, 3.0)) * others
    np.maximum(lit_share, 0, out=lit_share)
    np.maximum(dark, 0, out=dark)
    ones = [1.0] * drawn.count
    coverage = np.maximum(cover.astype(np.float32), 1) / 255
    lambert = drawn.layer(ones, lamp).astype(np.float32) / 255 / coverage
    half = lamp + [0.0, 0.0, 1.0]
    shine = drawn.layer(ones, half / np.linalg.norm(half)).astype(np.float32) / 255 / coverage
    power, gloss = np.exp(rng.uniform(np.log(4), np.log(60))), max(rng.uniform(-0.4, 0.5), 0.0)
    light = ambient * (0.4 + 0.6 * shine) * dark + key * lambert * lit_share
    bodies_lit = albedo * light + gloss * key * np.minimum(shine, 1) ** power * lit_share * coverage
    scene = scene * (1 - cover.astype(np.float32) / 255) + bodies_lit
    for mask, shade in before:
        cover_with(scene, mask, (ambient + key * 0.7) * shade)
    for _ in range(rng.choice([0, 1, 2], p=[0.7, 0.22, 0.08])):
        mask, bright = cable_mask(rng, shape, rng.uniform(0.008, 0.03) * shape[1])
        cover_with(scene, mask, (ambient + key * 0.7) * np.float32(rng.uniform(0.02, 0.9)) * bright)
    # Exposure: the 95 % quantile becomes nearly white, or is overexposed, or stays dark.
    exposed = scene * np.float32(np.exp(rng.uniform(np.log(0.5), np.log(1.3))) / np.quantile(scene[::4, ::4], 0.95))
    return (255 * np.clip(exposed, 0, 1) ** np.float32(1 / rng.uniform(1.0, 2.4)) + 0.5).astype(np.uint8)


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
    values = np.clip(shades[number] * (1 + rng.uniform(0, 0.6) * rings) + rng.uniform(-0.2, 0.2) * place, 0, 1)
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
