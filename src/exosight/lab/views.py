"""One view: the pose, its picture, the true and the estimated forces, and what the guard makes of it."""

import base64
import dataclasses
from collections.abc import Sequence
from functools import cache
from typing import Any

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, UInt8

from exosight.control import Guarded, Measurement, OnnxEstimator, Scheduled
from exosight.control.estimator import DEFAULT_MODEL, Reading
from exosight.control.paths import ControllerConfig, ForcePath
from exosight.control.tuning import ACTUATION_RATE, CONTACT_LIMIT
from exosight.dataset.frames import CAUSES
from exosight.dataset.simulation import first_cause
from exosight.exosuit.assembly import QUADRATURE, Exosuit, Pose, observe, varied
from exosight.exosuit.finger import SPHERES
from exosight.exosuit.shapes import radius
from exosight.exosuit.variation import Variant
from exosight.lab.pose_cache import STRIDE, TOP, CachedExosuit, PoseCache, Rest
from exosight.lab.settings import LARGEST, STEP, View, shape_of
from exosight.system.camera import Camera
from exosight.vision.appearance import (
    BACKGROUND_KINDS,
    OCCLUSION_KINDS,
    Appearance,
    AppearanceVariation,
    draw_appearance,
)
from exosight.vision.augment import augment
from exosight.vision.corruptions import CORRUPTIONS, corrupt
from exosight.vision.scene import picture

CAMERA = Camera()
"""What the network that comes with the package learned from."""

_WORDS = {
    "not_converged": "no stable pose was found at this actuation; what is seen is the best point",
    "crosses_itself": "the exosuit crosses itself, which the rod does not feel; datasets drop such frames",
    "tip_below_finger": "the exosuit's tip lies below the fingertip; datasets drop such frames",
}

_NEUTRAL = draw_appearance(AppearanceVariation(), 0, np.arange(1))
_SPOILT: dict[str, dict[str, float]] = {
    "blur": {"blur": 2.0},
    "occlusion": {
        "occlusion": 1.0 + OCCLUSION_KINDS.index("ellipse"),
        "occluded": 0.06,
        "occlusion_at": 0.5,
        "occlusion_shade": 0.4,
    },
    "background": {
        "background": 1.0 + BACKGROUND_KINDS.index("smooth"),
        "background_level": 0.6,
        "background_contrast": 0.3,
        "background_size": 0.3,
    },
}


@dataclasses.dataclass(frozen=True)
class Seen:
    """All that one view shows.

    rest        the equilibrium, and a shortest way to it
    pose        of it, without batch dimensions
    image       (height, width)   gray 0…255
    reading     what the network reads off the image, one row
    state       what the guard's state would be after seeing the image twice, and why
    """

    rest: Rest
    pose: Pose
    image: UInt8[np.ndarray, "height width"]
    reading: Reading
    state: tuple[str, str]


def exosuit_of(view: View) -> Exosuit:
    """The worn exosuit of a view."""
    longer, stiffer = view.finger_length, view.joint_stiffness
    return varied(
        Exosuit(shape_of(view), young=view.young, gap=view.gap),
        Variant(
            link_length=(longer, longer, longer, longer),
            finger_radius=view.finger_radius,
            joint_stiffness=(stiffer, stiffer, stiffer),
        ),
    )


def see(view: View, poses: PoseCache) -> Seen:
    """Everything that one view shows."""
    cached = poses.get(exosuit_of(view))
    rest = cached.at(drive_of(view))
    pose = jax.tree.map(
        lambda leaf: np.asarray(leaf)[0], observe(cached.stacked, jnp.asarray(rest.q)[None, None])
    )
    clean = picture(cached.exosuit, pose, CAMERA)
    image = photograph(view, clean)
    reading = network().read(image)
    one: Pose = jax.tree.map(lambda leaf: leaf[0], pose)
    return Seen(rest, one, image[0], reading, judge(image[0], reading))


def drive_of(view: View) -> tuple[int, ...]:
    """The actuations of a view, in steps."""
    return tuple(round(u / STEP) for u in view.drive)


@cache
def network() -> OnnxEstimator:
    """The network that comes with the package."""
    return OnnxEstimator.load(DEFAULT_MODEL)


def photograph(
    view: View, clean: UInt8[np.ndarray, "1 height width"], frame: int = 0
) -> UInt8[np.ndarray, "1 height width"]:
    """A clean picture as the view's camera takes it, corruption included.

    frame   of a sequence: decides the noise
    """
    changed = {
        "shift_x": view.shift_x,
        "shift_y": view.shift_y,
        "roll": view.roll,
        "zoom": view.zoom,
        "tilt_y": view.tilt,
        **_SPOILT.get(view.corruption, {}),
    }
    image = augment(clean, _appearance(changed))
    return corrupt(image, view.corruption, seed=0, first=frame) if view.corruption in CORRUPTIONS else image


def _appearance(changed: dict[str, float]) -> Appearance:
    return dataclasses.replace(
        _NEUTRAL, **{name: np.array([float(value)]) for name, value in changed.items()}
    )


def judge(image: UInt8[np.ndarray, "height width"], reading: Reading) -> tuple[str, str]:
    """The state of a guard at rest that is shown this picture twice, and why.

    Its limits are those by default; no law acts, so the paths it knows are flat.
    """
    guarded = Guarded(Scheduled(_AT_REST))
    for _ in range(guarded.guard.bad_frames):
        guarded.step(0.0, Measurement(image, reading))
    cause = guarded.log[-1].cause if guarded.log else "picture and estimate can be trusted"
    return guarded.state.value, cause


def _flat(u: Sequence[float]) -> ForcePath:
    return ForcePath(np.array(u), np.zeros((len(u), 7)), np.zeros(len(u), dtype=bool))


_AT_REST = ControllerConfig(
    loading=_flat((0.0, LARGEST)),
    unloading=_flat((LARGEST, 0.0)),
    contact_limit=np.full(7, CONTACT_LIMIT),
    rate=ACTUATION_RATE,
    period=0.1,
    smallest_gain=1.0,
    largest_gain=1.0,
)


def answer(view: View, cached: Exosuit, seen: Seen) -> dict[str, Any]:
    """A view as JSON values: millimetres and newtons."""
    notes = [_WORDS[cause] for cause in _causes(seen)]
    return {
        "drive": [round(STEP * k, 2) for k in seen.rest.drive],
        "converged": seen.rest.converged,
        "notes": notes,
        "scene": scene_of(cached, seen.pose),
        "image": base64.b64encode(png_of(seen.image)).decode(),
        "true": [round(float(force), 5) for force in seen.pose.forces],
        "F_net": round(float(seen.pose.net_force), 5),
        "reading": reading_of(seen.reading),
        "guard": {"state": seen.state[0], "cause": seen.state[1]},
    }


def _causes(seen: Seen) -> list[str]:
    path: Pose = jax.tree.map(lambda leaf: np.asarray(leaf)[None, None], seen.pose)
    cause = int(first_cause(np.array([[seen.rest.converged]]), path)[0, 0])
    return [] if cause == len(CAUSES) else [CAUSES[cause]]


def scene_of(cached: Exosuit, pose: Pose) -> dict[str, Any]:
    """What is drawn of a pose: axes and radii of both bodies, and the forces; [mm] and [N], x and z."""
    return {
        "exosuit": _millimetres(pose.centreline[:, ::2]),
        "exosuit_radius": _millimetres(radius(cached.shape.surface, QUADRATURE.points)),
        "finger": _millimetres(pose.finger[:, ::2]),
        "finger_radius": _millimetres(np.array(cached.finger.radii)),
        "contacts": [
            {
                "name": name,
                "at": _millimetres(at[::2]),
                "radius": _millimetres(size),
                "force": [round(float(f), 5) for f in force[::2]],
            }
            for name, size, at, force in zip(
                SPHERES, cached.finger.sphere_radii(), pose.spheres, pose.pushes, strict=True
            )
        ],
    }


def _millimetres(values: Any) -> Any:
    return np.round(1e3 * np.asarray(values, float), 2).tolist()


def reading_of(reading: Reading) -> dict[str, Any]:
    """An estimate as JSON values [N]."""

    def rounded(values: Float[np.ndarray, "1 7"]) -> list[float]:
        return [round(float(value), 5) for value in values[0]]

    return {
        "forces": rounded(reading.forces),
        "low": rounded(reading.low),
        "high": rounded(reading.high),
        "contact": rounded(reading.contact),
        "ood_score": round(float(reading.ood_score[0]), 3),
        "F_net": round(float(reading.forces.sum()), 5),
    }


def png_of(image: UInt8[np.ndarray, "height width"]) -> bytes:
    """A picture as a PNG file."""
    return cv2.imencode(".png", image)[1].tobytes()


PATH_DRIVES: tuple[tuple[int, ...], ...] = (
    *((k,) for k in range(16, TOP + 1, 16)),
    *((TOP, k) for k in range(TOP - 16, -1, -16)),
)
"""Drives whose equilibria, one after the other, make the path 0 → 4 → 0 N known, in parts of one call."""


def path_of(cached: CachedExosuit) -> dict[str, Any]:
    """F_net [N] at every load of 0 → 4 → 0 N."""
    steps = range(0, TOP + 1, STRIDE)
    ways = [[cached.at((k,)) for k in steps], [cached.at((TOP, k)) for k in steps]]
    up, down = (
        np.asarray(observe(cached.stacked, np.stack([rest.q for rest in way])[None]).net_force)[0]
        for way in ways
    )
    return {
        "u": [round(STEP * k, 2) for k in steps],
        "loading": np.round(up, 5).tolist(),
        "unloading": np.round(down, 5).tolist(),
        "stable": all(rest.converged for way in ways for rest in way),
    }
