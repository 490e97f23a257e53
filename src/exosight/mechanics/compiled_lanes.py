"""The step of `continuation`, compiled for robots side by side, and the numbers that go in and come out."""

from collections.abc import Callable, Hashable
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Float

from exosight.arrays import AnyArray
from exosight.mechanics.continuation_records import Records
from exosight.mechanics.continuation_state import SNAPS, ContinuationState
from exosight.mechanics.metric import Metric
from exosight.mechanics.packing import Packing
from exosight.mechanics.path_step import Carried, Layout, begun, layout_of, prepare, stepper
from exosight.scalar_program import Unrolled

Kinds = tuple[tuple[tuple[int, ...], np.dtype], ...]
"""Shape and type of each of a robot's arrays."""

Rows: TypeAlias = Float[np.ndarray, "robots row"]
"""Some `Robots`, each as a row."""


class Common(NamedTuple):
    """What robots have in common that are compiled for together.

    structure   of a robot, as JAX has it
    memories    shape of what each term with a memory remembers
    """

    structure: Hashable
    kinds: Kinds
    dofs: int
    channels: int
    memories: tuple[tuple[int, ...], ...]


def leaves_of(kinds: Kinds, arrays: Float[AnyArray, "*robots numbers"]) -> list[AnyArray]:
    """The arrays of robots, from all numbers of each one after the other."""
    ends = np.cumsum([int(np.prod(shape)) for shape, _ in kinds])
    split: Any = np.split if isinstance(arrays, np.ndarray) else jnp.split
    parts = split(arrays, ends[:-1].tolist(), axis=-1)
    return [
        part.reshape(*arrays.shape[:-1], *shape).astype(kind)
        for part, (shape, kind) in zip(parts, kinds, strict=True)
    ]


class Robots(NamedTuple):
    """Some robots, and what all evaluations of each have in common.

    arrays         (robots, numbers)     all arrays of a robot, one after the other
    factor, unit                         those of its `Metric`
    whitener       (robots, dofs, dofs)  inverse of `factor`
    design         (robots, handed)      what its program computes of the robot alone; empty without a program
    """

    arrays: Float[AnyArray, "robots numbers"]
    factor: Float[AnyArray, "robots dofs dofs"]
    unit: Float[AnyArray, " robots"]
    whitener: Float[AnyArray, "robots dofs dofs"]
    design: Float[AnyArray, "robots handed"]


class Given(NamedTuple):
    """What compiled code is told of the robot in each lane.

    total                        how many of the loads are meant; none if the robot stands still
    tolerance, max_iterations    see `SolverOptions`
    enough                       come back once so many lanes have their loads behind them; the same in all
    """

    robots: Robots
    loads: Float[AnyArray, "lanes room channels"]
    total: Float[AnyArray, " lanes"]
    tolerance: Float[AnyArray, " lanes"]
    max_iterations: Float[AnyArray, " lanes"]
    enough: Float[AnyArray, " lanes"]


class Start(NamedTuple):
    """The state of a robot that begins at 0, and where its pose, loads and memories stand in it."""

    state: Float[np.ndarray, " numbers"]
    poses: list[slice]
    loads: slice
    memories: list[list[slice]]


class Layouts(NamedTuple):
    """How each of these lies in rows; `own`: the rows within, `start`: of a robot that begins.

    now       of a `Carried` without its records: where a robot is
    records   of one of which nothing was found
    """

    robots: Packing
    given: Packing
    now: Packing
    own: Layout
    start: Start
    records: Records


class Compiled(NamedTuple):
    """Compiled for robots of one structure.

    layout    of rows
    prepare   arrays of some robots -> a row of numbers each, `Robots`
    advance   rows of `Given`, rows of where the robots are, and `Records` -> the latter two, once `enough`
              lanes have their loads behind them or one has no room for snaps
    """

    layout: Layouts
    prepare: Callable[[Float[np.ndarray, "robots numbers"]], Float[Array, "robots row"]]
    advance: Callable[
        [Float[np.ndarray, "lanes given"], Float[np.ndarray, "lanes now"], Records],
        tuple[Float[Array, "lanes now"], Records],
    ]


@lru_cache(maxsize=64)
def compiled(common: Common, program: Unrolled | None, room: int) -> Compiled:
    """For robots that have this in common, by their program or by XLA, and so many loads at a time."""

    def robot_of(arrays: AnyArray) -> Any:
        return jax.tree.unflatten(common.structure, leaves_of(common.kinds, arrays))

    def of_robot(arrays: AnyArray) -> Robots:
        robot = robot_of(arrays)
        metric = Metric.of(robot)
        whitener = solve_triangular(metric.factor, jnp.eye(robot.dofs), lower=True)
        return Robots(arrays, metric.factor, metric.unit, whitener, prepare(program, robot))

    numbers = sum(int(np.prod(shape)) for shape, _ in common.kinds)
    layout = _layouts(common, jax.eval_shape(of_robot, np.zeros(numbers)), room)

    def advance(rows: Array, state: Array, records: Records) -> tuple[Array, Records]:
        def one(row: Array, before: Array, found: Records) -> tuple[Array, Records]:
            given: Given = layout.given.unpack(row)
            limits = given.tolerance, given.max_iterations.astype(int)
            arrays, factor, unit, _, design = given.robots
            metric, total = Metric(jnp.asarray(factor), jnp.asarray(unit)), given.total.astype(int)
            enough = jax.lax.pmax(given.enough, "lanes")  # the same for all: lanes go on or stop together
            step = stepper(robot_of(arrays), metric, program, design, given.loads, total, *limits)

            def going(now: Carried) -> Array:
                arrived = jax.lax.psum((now.load == total).astype(int), "lanes")
                full = jax.lax.psum((now.snaps >= SNAPS).astype(int), "lanes")
                return (arrived < enough) & (full == 0)

            start = layout.now.unpack(before)._replace(records=found)
            now = jax.lax.while_loop(going, step, start)
            return jnp.asarray(layout.now.pack(now._replace(records=None))), now.records

        return jax.vmap(one, axis_name="lanes")(rows, state, records)

    # The lanes of a thread are its work; a second thread inside an operation would take it from the others.
    options = {"xla_cpu_multi_thread_eigen": False}
    return Compiled(
        layout,
        jax.jit(jax.vmap(lambda arrays: layout.robots.pack(of_robot(arrays))), compiler_options=options),
        jax.jit(advance, compiler_options=options),
    )


def _layouts(common: Common, robot: Robots, room: int) -> Layouts:
    memories = tuple(map(np.zeros, common.memories))
    start = begun(common.dofs, common.channels, memories, room)
    none = np.zeros(())
    given = Given(robot, np.zeros((room, common.channels)), none, none, none, none)
    own = layout_of(common.dofs, common.channels, common.memories)
    return Layouts(
        *map(Packing, (robot, given, start._replace(records=None))),
        own=own,
        start=_start(np.asarray(start.row), own.state),
        records=start.records,
    )


def _start(row: Float[np.ndarray, " numbers"], state: Packing) -> Start:
    places: ContinuationState = state.unpack(np.arange(float(state.numbers))[None])

    def where(part: Any) -> slice:
        return slice(int(np.min(part)), int(np.max(part)) + 1) if np.size(part) else slice(0, 0)

    return Start(
        row,
        [where(pose) for pose in (places.q, places.anchor.q, places.descent.q)],
        where(places.origin),
        [[where(part) for part in history] for history in (places.memories, places.anchor.memories)],
    )
