"""Shapes in, labelled images out: every shape driven 0 → 4 → 0 N, filtered and rendered.

This module needs JAX; reading a dataset, or `GenerateConfig`, does not.
"""

from collections.abc import Callable, Sequence

import jax
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int8, UInt8

from exosight.dataset.config import GenerateConfig
from exosight.dataset.frames import CAUSES, Frames, concatenate
from exosight.dataset.variation import appearance_of, lighting_of, variant_of
from exosight.exosuit.assembly import MAX_FORCE, Exosuit, Pose, assemble, observe, varied
from exosight.exosuit.scenarios import SampledShape
from exosight.exosuit.shapes import FAMILIES, ExosuitShape
from exosight.mechanics import drive, stack
from exosight.vision.appearance import AppearanceVariation
from exosight.vision.augment import augment
from exosight.vision.scene import cover, picture


def simulate_shapes(
    config: GenerateConfig,
    shapes: Sequence[SampledShape],
    done: Callable[[int], None] = lambda shapes: None,
) -> tuple[Frames, dict[str, int]]:
    """The frames of some shapes, and how many were dropped, by cause.

    Depends on the configuration and these shapes alone: the same whichever process simulates them, and when.

    done   called with the number of shapes finished, as they finish
    """
    loads, keep = load_path(config.frames)
    exosuits = [wear(config, sampled) for sampled in shapes]
    robots = [assemble(exosuit) for exosuit in exosuits]
    found = drive(robots, loads[:, None], done=done)
    found = jax.tree.map(lambda leaf: leaf[:, keep], found)
    pose: Pose = jax.tree.map(np.asarray, observe(stack(robots), found.q))
    causes = first_cause(np.asarray(found.converged), pose)
    lost = {cause: int(np.sum(causes == i)) for i, cause in enumerate(CAUSES)}
    parts = []
    for i, (sampled, exosuit) in enumerate(zip(shapes, exosuits, strict=True)):
        kept = causes[i] == len(CAUSES)
        q, own = jax.tree.map(lambda leaf, i=i, kept=kept: leaf[i, kept], (found.q, pose))
        images = depict(config, sampled, exosuit, own, np.flatnonzero(kept))
        parts.append(_frames(sampled, images, q, own, _driven(loads[keep], kept)))
    return concatenate(parts), lost


def wear(config: GenerateConfig, sampled: SampledShape) -> Exosuit:
    """The worn exosuit of one shape of a dataset, with what varies from shape to shape."""
    return varied(exosuit_of(config, sampled.shape), variant_of(config, sampled.shape_id))


def depict(
    config: GenerateConfig,
    sampled: SampledShape,
    exosuit: Exosuit,
    pose: Pose,
    places: Int[np.ndarray, " frames"],
) -> UInt8[np.ndarray, "frames height width"]:
    """The pictures of one shape of a dataset, with what varies from frame to frame.

    pose     of this exosuit, with one batch dimension: the frames
    places   of the frames on the path 0 → 4 → 0 N, from 0
    """
    numbers = sampled.shape_id * config.frames + places.astype(np.int64)
    images = picture(exosuit, pose, config.camera, lighting_of(config, numbers))
    if config.appearance == AppearanceVariation():
        return images
    return augment(images, appearance_of(config, numbers), cover(exosuit, pose, config.camera))


def exosuit_of(config: GenerateConfig, shape: ExosuitShape) -> Exosuit:
    """The nominal worn exosuit of any shape, with the constants of a dataset."""
    return Exosuit(shape, young=config.young, contact_stiffness=config.contact_stiffness, gap=config.gap)


def load_path(frames: int) -> tuple[Float[np.ndarray, " loads"], Bool[np.ndarray, " loads"]]:
    """The loads of 0 → 4 → 0 N [N], and which of them are frames: all but, if none is there, the turn at 4 N.

    The frames are spread evenly over the path.
    """
    way = np.linspace(0, 2 * MAX_FORCE, frames)
    way = np.union1d(way, MAX_FORCE) if frames % 2 == 0 else way
    keep = np.ones(len(way), bool) if frames % 2 else way != MAX_FORCE
    return np.minimum(way, 2 * MAX_FORCE - way), keep


def crosses_itself(line: Float[np.ndarray, "frames points 3"]) -> Bool[np.ndarray, " frames"]:
    """Whether the polyline, seen along y, crosses itself."""
    p, q = line[:, :-1, ::2], line[:, 1:, ::2]

    def side(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        return np.sign(
            (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1])
            - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
        )

    a, b = p[:, :, None], q[:, :, None]
    c, d = p[:, None], q[:, None]
    crossing = (side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)
    return np.asarray(crossing.any(axis=(1, 2)))


def first_cause(
    converged: Bool[np.ndarray, "shapes frames"], pose: Pose
) -> Int8[np.ndarray, "shapes frames"]:
    """Why each frame is dropped: index of the first of CAUSES that holds, or their number if none does."""
    faults = (
        ~converged,
        np.stack([crosses_itself(np.asarray(line)) for line in pose.centreline]),
        np.asarray(pose.centreline[:, :, -1, 2] < pose.finger[:, :, -1, 2]),
        np.ones_like(converged),
    )
    return np.argmax(np.stack(faults), axis=0).astype(np.int8)


def _driven(
    u: Float[np.ndarray, " frames"], kept: Bool[np.ndarray, " frames"]
) -> tuple[Float32[np.ndarray, " kept"], Int8[np.ndarray, " kept"]]:
    """Actuation and direction of loading of the frames kept."""
    loading = np.where(np.arange(len(u)) < len(u) / 2, 1, -1)
    return u[kept].astype(np.float32), loading[kept].astype(np.int8)


def _frames(
    sampled: SampledShape,
    images: UInt8[np.ndarray, "frames height width"],
    q: Float[np.ndarray, "frames dofs"],
    pose: Pose,
    driven: tuple[Float32[np.ndarray, " frames"], Int8[np.ndarray, " frames"]],
) -> Frames:
    u, loading = driven
    return Frames(
        images=images,
        forces=np.asarray(pose.forces[:, 1:], dtype=np.float32),
        u=u,
        pose=np.asarray(q, dtype=np.float64),
        shape_id=np.full(len(u), sampled.shape_id, dtype=np.int32),
        family=np.full(len(u), list(FAMILIES).index(sampled.shape.surface.family), dtype=np.int8),
        scenario=np.full(len(u), sampled.scenario, dtype=np.int8),
        loading=loading,
    )
