"""Frames from simulation: every shape driven 0 → 4 → 0 N, rendered, filtered and stored.

This module needs JAX; reading a dataset does not.
"""

from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import jax
import numpy as np
from jaxtyping import Bool, Float, Float32, Int8
from pydantic import Field
from pydantic.dataclasses import dataclass

from exosight.arrays import AnyArray
from exosight.dataset.frames import Frames
from exosight.dataset.manifest import ChunkEntry, Manifest, new_manifest, write_manifest
from exosight.dataset.store import write_chunk
from exosight.errors import DataError
from exosight.exosuit.assembly import MAX_FORCE, Exosuit, Pose, assemble, observe
from exosight.exosuit.scenarios import SampledShape, sample_shapes
from exosight.exosuit.shapes import FAMILIES
from exosight.mechanics import follow, stack
from exosight.vision.camera import Camera
from exosight.vision.scene import picture

MAX_STEP = 0.05
"""Largest step between two equilibria of a path [N]."""

SHAPES_PER_CHUNK = 64
"""Shapes simulated together and stored as one file: what a killed run loses at most."""

CAUSES = ("not_converged", "crosses_itself", "tip_below_finger")
"""Why a frame is dropped; a frame counts under the first cause that holds."""


@dataclass(frozen=True)
class GenerateConfig:
    """What a dataset is made of."""

    per_scenario: Annotated[int, Field(ge=1, le=401)] = 10
    """Shapes of each of the eleven scenarios; the paper has 125."""
    frames: Annotated[int, Field(ge=2, le=10_000)] = 50
    """Frames of each shape, evenly along 0 → 4 → 0 N."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the shapes."""
    young: Annotated[float, Field(ge=1e3, le=1e9)] = 300e3
    """Young's modulus of the exosuit [Pa]."""
    contact_stiffness: Annotated[float, Field(ge=1.0, le=1e6)] = 1000.0
    """Penalty stiffness of the contact spheres [N/m]."""
    gap: Annotated[float, Field(ge=0.0, le=0.1)] = 0.0
    """Clearance between exosuit and finger at the base [m]."""
    camera: Camera = Camera()
    """Camera of every image."""


def generate(
    config: GenerateConfig, folder: Path, progress: Callable[[int, int], None] = lambda done, total: None
) -> Manifest:
    """Simulate, render and store a dataset; the folder must not exist.

    progress   called with the shapes done and their total
    returns    the manifest, which also counts the frames dropped by cause

    Raises DataError if the folder exists or cannot be written, InputError if there are not so many shapes.
    """
    shapes = sample_shapes(config.per_scenario, config.seed)
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise DataError(f"{folder}: exists already; name a new folder, nothing is overwritten") from None
    except OSError as error:
        raise DataError(f"{folder}: cannot be made ({error.strerror})") from error
    chunks: list[ChunkEntry] = []
    dropped: dict[str, int] = dict.fromkeys(CAUSES, 0)
    done, dofs = 0, 0

    def step(finished: int) -> None:
        nonlocal done
        done += finished
        progress(done, len(shapes))

    for start in range(0, len(shapes), SHAPES_PER_CHUNK):
        frames, lost = simulate(config, shapes[start : start + SHAPES_PER_CHUNK], step)
        for cause, count in lost.items():
            dropped[cause] += count
        dofs = frames.pose.shape[1]
        if len(frames):
            chunks.append(write_chunk(folder, len(chunks), frames))
    manifest = new_manifest(
        config=asdict(config),  # type: ignore[call-overload]  # pydantic's dataclasses are dataclasses
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
    """The frames of some shapes, and how many were dropped, by cause."""
    u, keep = load_path(config.frames)
    exosuits = [
        Exosuit(s.shape, young=config.young, contact_stiffness=config.contact_stiffness, gap=config.gap)
        for s in shapes
    ]
    robots = [assemble(exosuit) for exosuit in exosuits]
    found = follow(robots, u[:, None], done=done)
    found = jax.tree.map(lambda leaf: leaf[:, keep], found)
    pose: Pose = jax.tree.map(np.asarray, observe(stack(robots), found.q))
    causes: np.ndarray = np.stack([~found.converged, *_faults(pose)])
    first = np.argmax(causes, axis=0)
    lost = {cause: int((causes.any(0) & (first == i)).sum()) for i, cause in enumerate(CAUSES)}
    kept = np.logical_not(causes.any(axis=0))
    rows = []
    for i, (shape, exosuit) in enumerate(zip(shapes, exosuits, strict=True)):
        q, own = jax.tree.map(lambda leaf, i=i: leaf[i, kept[i]], (found.q, pose))
        rows.append(_frames(shape, exosuit, config.camera, q, own, _driven(u[keep], kept[i])))
    joined = {name: np.concatenate([getattr(r, name) for r in rows]) for name in Frames.__dataclass_fields__}
    return Frames(**joined), lost


def load_path(frames: int) -> tuple[Float[np.ndarray, " loads"], slice]:
    """The loads [N] of 0 → 4 → 0 N in steps of at most 0.05 N, and which of them are frames.

    The frames are spread evenly over the path; the loads in between divide the way from frame to frame into
    equal steps, so that every frame is an equilibrium of its own and none is interpolated.
    """
    substeps = int(np.ceil(2 * MAX_FORCE / (frames - 1) / MAX_STEP - 1e-9))
    substeps += (frames - 1) * substeps % 2  # the turning point at 4 N is a load too
    way = np.linspace(0, 2 * MAX_FORCE, (frames - 1) * substeps + 1)
    return np.minimum(way, 2 * MAX_FORCE - way), slice(None, None, substeps)


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
    return np.any(np.asarray(crossing), axis=(1, 2), keepdims=True)[:, 0, 0]


def _faults(pose: Pose) -> Iterator[Bool[AnyArray, "shapes frames"]]:
    yield np.stack([crosses_itself(line) for line in pose.centreline])
    yield pose.centreline[:, :, -1, 2] < pose.finger[:, :, -1, 2]


def _driven(
    u: Float[np.ndarray, " frames"], kept: Bool[np.ndarray, " frames"]
) -> tuple[Float32[np.ndarray, " kept"], Int8[np.ndarray, " kept"]]:
    """Actuation and direction of loading of the frames kept."""
    loading = np.where(np.arange(len(u)) < len(u) / 2, 1, -1)
    return u[kept].astype(np.float32), loading[kept].astype(np.int8)


def _frames(
    shape: SampledShape,
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
        shape_id=np.full(len(u), shape.shape_id, dtype=np.int32),
        family=np.full(len(u), list(FAMILIES).index(shape.shape.surface.family), dtype=np.int8),
        scenario=np.full(len(u), shape.scenario, dtype=np.int8),
        loading=loading,
    )
