"""The step of `continuation` on rows of numbers: by XLA, or as a program (`exosight.scalar_program`).

A step has two halves, between which a descent finds how far it may go (`descent.damped`, a loop of unknown
length). What the second half needs of the first, a program leaves in its memory.
"""

from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.mechanics.acceptance import Segment
from exosight.mechanics.continuation import Looked, go_on, look
from exosight.mechanics.continuation_records import Records, put
from exosight.mechanics.continuation_state import DESCEND, SNAPS, ContinuationState, OfLoad, OfSnap, begin
from exosight.mechanics.descent import Asked, Damped, attempt, damped
from exosight.mechanics.energy import potential
from exosight.mechanics.evaluator import Energy
from exosight.mechanics.known_numbers import Known, with_known
from exosight.mechanics.metric import Metric
from exosight.mechanics.packing import Packing
from exosight.mechanics.robot import Robot
from exosight.mechanics.term import Memories
from exosight.scalar_program import Held, Unrolled, Unsupported, call_unrolled, unroll

Matrices = tuple[Float[AnyArray, "dofs dofs"], ...]
"""∂∇Π/∂q: the Hessian, and of robots with a memory the coupling."""


class Layout(NamedTuple):
    """How numbers lie in rows: of the state (without counters and matrices), a load, and a snap."""

    state: Packing
    of_load: Packing
    of_snap: Packing


@lru_cache(maxsize=64)
def layout_of(dofs: int, channels: int, memories: tuple[tuple[int, ...], ...]) -> Layout:
    """That of robots of so many coordinates and loads, whose terms have memories of these shapes."""
    q, load, number = np.zeros(dofs), np.zeros(channels), np.zeros(())
    whole, flag = np.zeros((), int), np.zeros((), bool)
    history = tuple(map(np.zeros, memories))
    found = OfLoad(q, number, number, number, number, whole, flag, flag, flag, load, history)
    snap = OfSnap(whole, load, q, q, number, number)
    state = jax.tree.map(np.asarray, _bare(begin(q, load, history)))
    return Layout(Packing(state), Packing(found), Packing(snap))


def _bare(state: ContinuationState) -> Any:
    here = state.descent.here._replace(hessian=None, coupling=None)
    return state._replace(load=None, snaps=None, descent=state.descent._replace(here=here))


class Carried(NamedTuple):
    """What a step changes.

    row        of the state, see `Layout`; `load` and `snaps` of it stand apart
    matrices   of its descent, at the point accepted last
    """

    row: Float[AnyArray, " numbers"]
    load: Int[AnyArray, ""]
    snaps: Int[AnyArray, ""]
    matrices: Matrices
    records: Records


def begun(dofs: int, channels: int, memories: Memories, room: int) -> Carried:
    """A robot that begins with its pose and loads at 0, with room for what is found at so many loads."""
    layout = layout_of(dofs, channels, tuple(map(np.shape, memories)))
    state = jax.tree.map(np.asarray, _bare(begin(np.zeros(dofs), np.zeros(channels), memories)))
    matrix = np.zeros((dofs, dofs))
    records = Records(
        np.zeros((room + 1, layout.of_load.numbers + dofs**2)),
        np.zeros((SNAPS + 1, layout.of_snap.numbers)),
    )
    none = np.zeros((), int)
    return Carried(layout.state.pack(state), none, none, (matrix,) * (2 if memories else 1), records)


class At(NamedTuple):
    """What the first half of a step is told beside the robot; whole numbers may come as floats."""

    row: Float[AnyArray, " numbers"]
    load: Float[AnyArray, ""]
    snaps: Float[AnyArray, ""]
    matrices: Matrices
    target: Float[AnyArray, " channels"]
    after: Float[AnyArray, " channels"]
    total: Float[AnyArray, ""]
    tolerance: Float[AnyArray, ""]
    max_iterations: Float[AnyArray, ""]


class Half(NamedTuple):
    """What the first half tells: what is asked of the descent, and the matrices at the trial point.

    accepted     a descent goes on from there
    descending   the robot is in one
    """

    asked: Asked
    matrices: Matrices
    accepted: Bool[AnyArray, ""]
    descending: Bool[AnyArray, ""]


class Stepped(NamedTuple):
    """What the second half tells: the row of the state, and of what is to be recorded, if it is."""

    row: Float[AnyArray, " numbers"]
    load: Int[AnyArray, ""]
    snaps: Int[AnyArray, ""]
    done: Bool[AnyArray, ""]
    jumped: Bool[AnyArray, ""]
    of_load: Float[AnyArray, " row"]
    of_snap: Float[AnyArray, " row"]


def _first_half(robot: Robot, metric: Metric, energy: Energy, layout: Layout, at: At) -> tuple[Half, Looked]:
    state: ContinuationState = layout.state.unpack(at.row)
    load, snaps, total, max_iterations = (
        jnp.asarray(number).astype(int) for number in (at.load, at.snaps, at.total, at.max_iterations)
    )
    here = state.descent.here._replace(hessian=at.matrices[0], coupling=(*at.matrices, None)[1])
    state = state._replace(load=load, snaps=snaps, descent=state.descent._replace(here=here))
    segment = Segment.of(state.origin, at.target, at.after, total)
    asked, seen = look(robot, metric, energy, state, segment, at.tolerance, max_iterations)
    return Half(asked, _matrices(seen.reached.here), seen.accepted, state.phase == DESCEND), seen


def _second_half(robot: Robot, layout: Layout, seen: Looked, found: Damped) -> Stepped:
    state, entry = go_on(robot, seen, found)
    rows = (
        layout.state.pack(_bare(state)),
        layout.of_load.pack(entry.of_load),
        layout.of_snap.pack(entry.of_snap),
    )
    return Stepped(rows[0], state.load, state.snaps, entry.done, entry.jumped, *rows[1:])


def _matrices(here: Any) -> Matrices:
    return (here.hessian,) if here.coupling is None else (here.hessian, here.coupling)


def stepper(
    robot: Robot,
    metric: Metric,
    program: Unrolled | None,
    design: Float[AnyArray, " handed"],
    loads: Float[AnyArray, "loads channels"],
    total: Int[AnyArray, ""],
    tolerance: Float[AnyArray, ""],
    max_iterations: Int[AnyArray, ""],
) -> Callable[[Carried], Carried]:
    """The function that takes a robot one evaluation further; only the first `total` loads are meant.

    program   of its structure, `design` what it computes of the robot alone; without one XLA does the same
    """
    layout = layout_of(robot.dofs, loads.shape[1], tuple(map(np.shape, robot.memories)))
    matrix = metric.factor @ metric.factor.T
    if program is None:
        first: Any = partial(_first_half, robot, metric, potential(robot), layout)
        second: Any = partial(_second_half, robot, layout)
        attempted: Callable[..., tuple] = attempt
    else:
        first = partial(program, 1, Held.of(design))
        second = partial(_second_half_of, program)
        attempted = partial(call_unrolled, attempt)

    def step(now: Carried) -> Carried:
        target, after = (
            jax.lax.dynamic_index_in_dim(loads, jnp.minimum(now.load + i, total - 1), keepdims=False)
            for i in (0, 1)
        )
        at = At(now.row, now.load, now.snaps, now.matrices, target, after, total, tolerance, max_iterations)
        half, seen = first(at)
        kept = _chosen(half.accepted, half.matrices, now.matrices)
        stepped = second(seen, damped(attempted, kept[0], matrix, half.asked))
        hessian, *coupling = _chosen(half.descending, kept, half.matrices)
        jacobian = sum(coupling, start=hessian)
        records = Records(
            put(now.records.loads, now.load, stepped.done, stepped.of_load, jnp.ravel(jacobian)),
            put(now.records.snaps, now.snaps, stepped.jumped, stepped.of_snap),
        )
        return Carried(stepped.row, stepped.load, stepped.snaps, kept, records)

    return step


def _second_half_of(program: Unrolled, before: Held, found: Damped) -> Stepped:
    return program(2, before, found)[0]


def _chosen(first: AnyArray, one: Matrices, other: Matrices) -> Matrices:
    return tuple(jnp.where(first, a, b) for a, b in zip(one, other, strict=True))


def prepare(program: Unrolled | None, robot: Robot) -> Float[Array, " handed"]:
    """What a program of its structure computes of the robot alone; nothing without a program."""
    return jnp.zeros(0) if program is None else program(0, None, jax.tree.leaves(robot))[1].row


@lru_cache(maxsize=64)
def program_of(
    structure: Hashable, shapes: Sequence[tuple[int, ...]], channels: int, known: Known = b""
) -> Unrolled | None:
    """The program of robots of a structure whose arrays have these shapes; None where there is none.

    known   `known_numbers` of all these robots

    There is none without a CPU, or where a function holds what cannot be unrolled.
    """
    if jax.default_backend() != "cpu":
        return None
    leaves = [np.zeros(shape) for shape in shapes]
    robot: Robot = jax.tree.unflatten(structure, leaves)
    layout = layout_of(robot.dofs, channels, tuple(map(np.shape, robot.memories)))
    start = begun(robot.dofs, channels, robot.memories, room=1)
    q, load, number = np.zeros(robot.dofs), np.zeros(channels), np.zeros(())

    def function(leaves: list[Array], at: At, found: Damped) -> tuple[tuple, Half, Stepped]:
        robot = jax.tree.unflatten(structure, with_known(structure, known, leaves))
        half, seen = _first_half(robot, Metric.of(robot), potential(robot), layout, at)
        return (), half, _second_half(robot, layout, seen, found)

    at = At(start.row, number, number, start.matrices, load, load, number, number, number)
    try:
        return unroll(function, [leaves, at, Damped(q, number, number, number)])
    except Unsupported:
        return None
