"""Designs in, labelled images out: every design driven along its load path, filtered and rendered.

This module needs JAX; reading a dataset, or `GenerateConfig`, does not.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int, Int8, UInt8

from exosight.arrays import AnyArray
from exosight.dataset.config import GenerateConfig
from exosight.dataset.frames import Frames, concatenate
from exosight.dataset.load_paths import LoadPath, load_path
from exosight.dataset.variation import PHOTO, appearance_of, lighting_of
from exosight.mechanics import Equilibria, Rod, drive
from exosight.mechanics.batched_continuation import Kept
from exosight.system.design import Design
from exosight.system.designs import DesignSet
from exosight.system.observation import Observation, observe
from exosight.system.system import System, stack_systems
from exosight.vision.appearance import AppearanceVariation
from exosight.vision.augment import augment
from exosight.vision.photo import photo
from exosight.vision.scene import cover, picture, tubes

_TOGETHER = 16
"""Systems observed in one call."""


def causes(designs: DesignSet) -> tuple[str, ...]:
    """Why frames are dropped; a frame counts under the first cause that holds."""
    return ("not_converged", "crosses_itself", *designs.filters)


def simulate_designs(
    config: GenerateConfig, designs: DesignSet, chosen: Sequence[Design]
) -> tuple[Frames, dict[str, int]]:
    """The frames of some designs, and how many were dropped, by cause: `solve_designs`, then `frames_of`."""
    return frames_of(config, designs, chosen, solve_designs(config, designs, chosen))


class Solved(NamedTuple):
    """Some designs at the frames of their paths.

    found   their equilibria, with batch shape (designs, frames)
    """

    systems: list[System]
    paths: list[LoadPath]
    found: Equilibria


def solve_designs(
    config: GenerateConfig,
    designs: DesignSet,
    chosen: Sequence[Design],
    done: Callable[[int], None] = lambda designs: None,
    kept: Kept | None = None,
) -> Solved:
    """The equilibria of every design at the frames of its path.

    Depends on the configuration and these designs alone: the same whichever process solves them, and when.

    done   called with the number of designs finished, as they finish
    kept   designs that an earlier call solved; keeps what this one does
    """
    systems = [designs.build(design) for design in chosen]
    paths = [load_path(designs.schema, config.frames, config.seed, design.number) for design in chosen]
    loads = [system.loads(path.commands) for system, path in zip(systems, paths, strict=True)]
    found = drive([system.robot for system in systems], np.stack(loads), done=done, kept=kept)
    frames = paths[0].frames
    return Solved(systems, paths, jax.tree.map(lambda leaf: leaf[:, frames], found))


def frames_of(
    config: GenerateConfig, designs: DesignSet, chosen: Sequence[Design], solved: Solved
) -> tuple[Frames, dict[str, int]]:
    """What is seen and measured of solved designs, filtered, and how many frames were dropped, by cause."""
    systems, paths, found = solved
    seen = _observed(systems, found)
    cause = first_cause(designs, systems[0], np.asarray(found.converged), seen)
    names = causes(designs)
    parts = []
    for i, (design, system, path) in enumerate(zip(chosen, systems, paths, strict=True)):
        places = np.flatnonzero(cause[i] == len(names))
        own: Observation = jax.tree.map(lambda leaf, i=i, at=places: leaf[i, at], seen)
        parts.append(
            Frames(
                schema=designs.schema,
                images=render_design(config, system, own, design, places),
                sensors=np.asarray(own.readings, np.float32),
                commands=path.commands[path.frames][places].astype(np.float32),
                pose=np.asarray(found.q[i, places], np.float64),
                design=np.full(len(places), design.number, np.int32),
                family=np.full(len(places), design.family, np.int8),
                scenario=np.full(len(places), design.scenario, np.int8),
                step=places.astype(np.int32),
            )
        )
    return concatenate(parts), {name: int(np.sum(cause == k)) for k, name in enumerate(names)}


def render_design(
    config: GenerateConfig,
    system: System,
    seen: Observation,
    design: Design,
    places: Int[np.ndarray, " frames"],
) -> UInt8[np.ndarray, "frames height width"]:
    """The pictures of one design of a dataset, with what varies from frame to frame.

    seen     of this system, with one batch dimension: the frames
    places   of the frames on the design's path, from 0
    """
    numbers = design.number * config.frames + places.astype(np.int64)
    images = picture(system, seen.axes, lighting_of(config, numbers, system))
    if config.photo:
        return photo(tubes(system, seen.axes), system.camera, images, (config.seed, PHOTO), numbers)
    if config.appearance == AppearanceVariation():
        return images
    return augment(images, appearance_of(config, numbers), cover(system, seen.axes))


CROSSING = (
    "a rod crosses itself, which it does not feel; choose a smaller command, or a thicker, shorter or "
    "stiffer rod"
)
"""What is said of such a pose."""


def crossing(
    system: System, axes: Mapping[str, Float[AnyArray, "frames nodes 3"]]
) -> Bool[np.ndarray, " frames"]:
    """Where a tube that is drawn along a rod crosses itself."""
    rods = {body.name for body in system.bodies if isinstance(body, Rod)}
    found = np.zeros(len(next(iter(axes.values()))), bool)
    for tube in system.tubes:
        if {body for body, _ in tube.nodes} <= rods:
            found |= crosses_itself(np.asarray(axes[tube.name]))
    return found


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
    designs: DesignSet, system: System, converged: Bool[np.ndarray, "designs frames"], seen: Observation
) -> Int8[np.ndarray, "designs frames"]:
    """Why each frame is dropped: index of the first of `causes` that holds, or their number if none does.

    system   any of the observed ones: for which tubes are drawn along rods
    """
    crosses = np.stack(
        [crossing(system, {name: axis[i] for name, axis in seen.axes.items()}) for i in range(len(converged))]
    )
    own = [np.asarray(leaves_out(seen)) for leaves_out in designs.filters.values()]
    faults = (~converged, crosses, *own, np.ones_like(converged))
    return np.argmax(np.stack(faults), axis=0).astype(np.int8)


def _observed(systems: Sequence[System], found: Equilibria) -> Observation:
    """What is seen of the systems, some at a time: chunks of any size share what is compiled."""
    parts = []
    for start in range(0, len(systems), _TOGETHER):
        rows = np.minimum(np.arange(start, start + _TOGETHER), len(systems) - 1)
        some = stack_systems([systems[row] for row in rows])
        seen = observe(some, found.q[rows], tuple(memory[rows] for memory in found.history))
        left = len(systems) - start
        parts.append(jax.tree.map(lambda leaf, left=left: np.asarray(leaf)[:left], seen))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)
