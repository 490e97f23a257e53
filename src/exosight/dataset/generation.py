"""Frames from simulation: every shape driven 0 → 4 → 0 N, rendered, filtered and stored.

This module needs JAX; reading a dataset, or `GenerateConfig`, does not.
"""

from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Bool, Float, Float32, Int8
from pydantic import TypeAdapter

from exosight.dataset.config import GenerateConfig
from exosight.dataset.frames import Frames, concatenate
from exosight.dataset.manifest import LARGEST_FRAMES, ChunkEntry, Manifest, new_manifest, write_manifest
from exosight.dataset.store import write_chunk
from exosight.errors import DataError, InputError
from exosight.exosuit.assembly import MAX_FORCE, Exosuit, Pose, assemble, observe
from exosight.exosuit.scenarios import SampledShape, sample_shapes
from exosight.exosuit.shapes import FAMILIES, ExosuitShape
from exosight.mechanics import follow, stack
from exosight.vision.camera import Camera
from exosight.vision.scene import picture

MAX_STEP = 0.05
"""Largest step between two equilibria of a path [N]."""

SHAPES_PER_CHUNK = 64
"""Shapes simulated together and stored as one file: bounds the memory that a large dataset takes."""

CAUSES = ("not_converged", "crosses_itself", "tip_below_finger")
"""Why a frame is dropped; a frame counts under the first cause that holds."""


def generate(
    config: GenerateConfig, folder: Path, progress: Callable[[int, int], None] = lambda done, total: None
) -> Manifest:
    """Simulate, render and store a dataset; the folder must not exist.

    progress   called with the shapes done and their total
    returns    the manifest, which also counts the frames dropped by cause

    Raises DataError if the folder exists or cannot be written, InputError if the dataset would be too large
    to be read again, or if no frame of it is worth keeping.
    """
    shapes = sample_shapes(config.per_scenario, config.seed)
    _check_size(config, len(shapes))
    _make(folder)
    chunks: list[ChunkEntry] = []
    dropped: dict[str, int] = dict.fromkeys(CAUSES, 0)
    done, dofs = 0, 0

    def step(finished: int) -> None:
        nonlocal done
        done += finished
        progress(done, len(shapes))

    step(0)
    for start in range(0, len(shapes), SHAPES_PER_CHUNK):
        frames, lost = simulate(config, shapes[start : start + SHAPES_PER_CHUNK], step)
        for cause, count in lost.items():
            dropped[cause] += count
        dofs = frames.pose.shape[1]
        if len(frames):
            chunks.append(write_chunk(folder, len(chunks), frames))
    if not chunks:
        folder.rmdir()
        reasons = ", ".join(f"{cause.replace('_', ' ')} {count}" for cause, count in dropped.items())
        raise InputError(
            f"dataset: no frame is worth keeping ({reasons}); change young, contact_stiffness or gap"
        )
    manifest = new_manifest(
        config=TypeAdapter(GenerateConfig).dump_python(config, mode="json"),
        seed=config.seed,
        camera=config.camera,
        load_limit=MAX_FORCE,
        dofs=dofs,
        shapes=shapes,
        chunks=chunks,
        dropped=dropped,
    )
    write_manifest(folder, manifest)
    return manifest


def simulate(
    config: GenerateConfig, shapes: list[SampledShape], done: Callable[[int], None] = lambda shapes: None
) -> tuple[Frames, dict[str, int]]:
    """The frames of some shapes, and how many were dropped, by cause.

    done   called with the number of shapes finished, as they finish
    """
    loads, keep = load_path(config.frames)
    exosuits = [exosuit_of(config, sampled.shape) for sampled in shapes]
    robots = [assemble(exosuit) for exosuit in exosuits]
    found = follow(robots, loads[:, None], done=done)
    found = jax.tree.map(lambda leaf: leaf[:, keep], found)
    pose: Pose = jax.tree.map(np.asarray, observe(stack(robots), found.q))
    causes = first_cause(np.asarray(found.converged), pose)
    lost = {cause: int(np.sum(causes == i)) for i, cause in enumerate(CAUSES)}
    parts = []
    for i, (sampled, exosuit) in enumerate(zip(shapes, exosuits, strict=True)):
        kept = causes[i] == len(CAUSES)
        q, own = jax.tree.map(lambda leaf, i=i, kept=kept: leaf[i, kept], (found.q, pose))
        parts.append(_frames(sampled, exosuit, config.camera, q, own, _driven(loads[keep], kept)))
    return concatenate(parts), lost


def exosuit_of(config: GenerateConfig, shape: ExosuitShape) -> Exosuit:
    """The worn exosuit of a shape as a dataset has it."""
    return Exosuit(shape, young=config.young, contact_stiffness=config.contact_stiffness, gap=config.gap)


def load_path(frames: int) -> tuple[Float[np.ndarray, " loads"], slice]:
    """The loads [N] of 0 → 4 → 0 N in steps of at most 0.05 N, and which of them are frames.

    The frames are spread evenly over the path; the loads in between divide the way from frame to frame into
    equal steps, so that every frame is an equilibrium of its own and none is interpolated.
    """
    substeps = int(np.ceil(2 * MAX_FORCE / (frames - 1) / MAX_STEP - 1e-9))
    substeps += (frames - 1) * substeps % 2  # the turning point at 4 N is a load too
    rising = np.linspace(0, MAX_FORCE, (frames - 1) * substeps // 2 + 1)
    return np.concatenate([rising, rising[-2::-1]]), slice(None, None, substeps)


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


def _check_size(config: GenerateConfig, shapes: int) -> None:
    camera = config.camera
    needed = shapes * config.frames * camera.height * camera.width
    if needed > LARGEST_FRAMES:
        raise InputError(
            f"dataset: {shapes} shapes with {config.frames} frames of {camera.width}×{camera.height} pixels "
            f"take {needed / 2**30:.0f} GiB, and at most {LARGEST_FRAMES >> 30} GiB can be read; "
            "choose fewer shapes or frames, or smaller images"
        )


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise DataError(f"{folder}: exists already; name a new folder, nothing is overwritten") from None
    except OSError as error:
        raise DataError(f"{folder}: cannot be made ({error.strerror}); name another folder") from error


def _driven(
    u: Float[np.ndarray, " frames"], kept: Bool[np.ndarray, " frames"]
) -> tuple[Float32[np.ndarray, " kept"], Int8[np.ndarray, " kept"]]:
    """Actuation and direction of loading of the frames kept."""
    loading = np.where(np.arange(len(u)) < len(u) / 2, 1, -1)
    return u[kept].astype(np.float32), loading[kept].astype(np.int8)


def _frames(
    sampled: SampledShape,
    exosuit: Exosuit,
    camera: Camera,
    q: Float[np.ndarray, "frames dofs"],
    pose: Pose,
    driven: tuple[Float32[np.ndarray, " frames"], Int8[np.ndarray, " frames"]],
) -> Frames:
    u, loading = driven
    return Frames(
        images=picture(exosuit, pose, camera),
        forces=np.asarray(pose.forces[:, 1:], dtype=np.float32),
        u=u,
        pose=np.asarray(q, dtype=np.float64),
        shape_id=np.full(len(u), sampled.shape_id, dtype=np.int32),
        family=np.full(len(u), list(FAMILIES).index(sampled.shape.surface.family), dtype=np.int8),
        scenario=np.full(len(u), sampled.scenario, dtype=np.int8),
        loading=loading,
    )
