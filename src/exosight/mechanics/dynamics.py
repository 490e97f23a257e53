"""Motion in time, many robots at a time.

The same energies as in statics, with inertia and viscosity (`equation_of_motion`), in implicit steps of
fourth order that follow a tolerance (`timestep`).
"""

import os
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from threading import Event

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.mechanics.integration_state import IntegrationState, Interval, begin
from exosight.mechanics.robot import Robot
from exosight.mechanics.step_control import StepLimits
from exosight.mechanics.term import Memories
from exosight.mechanics.timestep import TABLEAU, integrate


@dataclass(frozen=True)
class MotionOptions:
    """How finely a motion is computed.

    tolerance   [m]  error of one step, as the root mean square displacement of the robot's mass: that of the
                     poses, and that of the velocities times the step
    step        [s]  a fixed step instead, shortened only where Newton's method needs it; the tolerance then
                     bounds the error of that alone
    max_steps        steps between two reported times before a robot is given up
    lanes            robots stepped side by side in one compiled call
    """

    tolerance: float = 1e-7
    step: float | None = None
    max_steps: int = 10_000
    lanes: int = 8

    def __post_init__(self) -> None:
        step = 1.0 if self.step is None else self.step
        if not (0 < self.tolerance < np.inf and 0 < step < np.inf and self.max_steps > 0 and self.lanes > 0):
            raise InputError(f"motion: expected finite tolerance, step, max_steps, lanes above 0, got {self}")


class Trajectories(eqx.Module):
    """What moved where; every field but `time` may carry leading batch dimensions.

    time         (times,)        [s]
    q, velocity  (times, dofs)   coordinates, and their rates [1/s]
    kinetic      (times,)        kinetic energy [J]
    potential    (times,)        potential energy Π at that time's loads [J]
    dissipated   (times,)        what viscosity, damping, friction, relaxation took since the first time [J]
    supplied     (times,)        what changing loads gave since then, ∫ ∂Π/∂u · du [J]
    steps        (times,)        steps taken since then
    rejected     (times,)        steps tried and taken back since then
    converged    (times,)        this time was reached; if not, the other fields are from where it gave up
    history      (times, ...)    what each term with a memory remembers then, see `TermWithMemory`

    kinetic + potential + dissipated − supplied is constant, but for the error of the steps and what forces
    without a potential do.
    """

    time: Float[AnyArray, " times"]
    q: Float[AnyArray, "*batch times dofs"]
    velocity: Float[AnyArray, "*batch times dofs"]
    kinetic: Float[AnyArray, "*batch times"]
    potential: Float[AnyArray, "*batch times"]
    dissipated: Float[AnyArray, "*batch times"]
    supplied: Float[AnyArray, "*batch times"]
    steps: Int[AnyArray, "*batch times"]
    rejected: Int[AnyArray, "*batch times"]
    converged: Bool[AnyArray, "*batch times"]
    history: Memories = ()


def evolve(
    robots: Sequence[Robot],
    times: Float[np.ndarray, " times"],
    loads: Float[np.ndarray, "rows channels"] | None = None,
    *,
    q: Float[np.ndarray, "robots dofs"] | None = None,
    velocity: Float[np.ndarray, "robots dofs"] | None = None,
    options: MotionOptions = MotionOptions(),
    done: Callable[[int], None] = lambda robots: None,
) -> Trajectories:
    """The motion of each robot, reported at given times.

    robots     robots of one structure (same bodies, bases, points and terms)
    times      (times,)            [s], ascending; the first is when the motion starts
    loads      (times, channels)   u of each term's channel [N] then, linear in between; none by default
    q          (robots, dofs)      where the motion starts; the unstrained pose by default
    velocity   (robots, dofs)      and how fast [1/s]; at rest by default
    done       called with the number of robots finished, as they finish
    returns    Trajectories with batch shape (robots,)

    Terms with a memory begin with that of their robot (`Robot.with_memories`) and take each step as a whole:
    relaxation is of second order in it, and friction of first order where the direction of a slip turns.

    A robot whose motion cannot be continued says so in `converged` and stays where it is. Compiled once a
    structure and number of lanes. Raises InputError for what does not fit, and for a robot that has a
    coordinate which moves no mass.

    Fourth order in the step: each of ωh radians shifts the phase of a vibration by (ωh)⁵/1200 and takes
    (ωh)⁶/18000 of its energy; vibrations much faster than the steps are damped out. Contacts and other forces
    with kinks cost smaller steps; a step ends where the first open pair would close at the speed it starts
    with. Free, ball and planar joints without springs, dampers, a range or a motor may turn on and on: beyond
    200° their coordinates jump to those of the same pose by the smaller turn, so a term of one's own must not
    look at them. With any of these, 360° is singular: rates grow without bound there, and dampers with them.
    """
    times, loads, starts = _checked(robots, times, loads, q, velocity)
    lanes = min(options.lanes, 1 << (len(robots) - 1).bit_length())
    groups = [range(i, min(i + lanes, len(robots))) for i in range(0, len(robots), lanes)]
    stopped = Event()

    def work(group: range) -> IntegrationState:
        rows = [group[min(i, len(group) - 1)] for i in range(lanes)]  # the last one again in idle lanes
        states = _integrated([robots[i] for i in rows], times, loads, starts[:, rows], options, stopped)
        if np.any(states.failed[: len(group), 0]):
            number = group[int(np.argmax(states.failed[: len(group), 0]))]
            which = f"robots[{number}]" if len(robots) > 1 else "motion"
            raise InputError(
                f"{which}: no finite acceleration at the start: some coordinate moves no "
                "mass; give links mass or inertia, rods a density"
            )
        done(len(group))
        return jax.tree.map(lambda x: x[: len(group)], states)

    with ThreadPoolExecutor(max_workers=min(os.cpu_count() or 1, len(groups))) as pool:
        try:
            parts = [future.result() for future in [pool.submit(work, group) for group in groups]]
        except BaseException:  # Ctrl-C too: the pool waits for its threads
            stopped.set()
            raise
    state = jax.tree.map(lambda *parts: np.concatenate(parts), *parts)
    return Trajectories(
        time=times,
        q=state.q,
        velocity=state.v,
        **state.energies._asdict(),
        steps=state.steps,
        rejected=state.rejected,
        converged=~state.failed,
        history=state.memories,
    )


def _integrated(
    robots: Sequence[Robot],
    times: Float[np.ndarray, " times"],
    loads: Float[np.ndarray, "times channels"],
    starts: Float[np.ndarray, "2 robots dofs"],
    options: MotionOptions,
    stopped: Event,
) -> IntegrationState:
    """The states (robots, times, …) of robots side by side.

    They end early where one of them fails to start, or once `stopped` is set.
    """
    leaves = [np.stack(parts) for parts in zip(*(_leaves(robot) for robot in robots), strict=True)]
    states = [
        begin(times[0], q, v, robot.memories, loads.shape[1], TABLEAU.stages)
        for robot, q, v in zip(robots, *starts, strict=True)
    ]
    state = jax.tree.map(lambda *parts: np.stack(parts), *states)
    limits = StepLimits(
        tolerance=np.array(options.tolerance),
        largest=np.array(np.inf if options.step is None else options.step),
        adaptive=np.array(options.step is None),
        max_steps=np.array(options.max_steps),
    )
    compiled = _compiled(jax.tree.structure(robots[0]))
    found = []
    for k, until in enumerate(times):
        at = max(k - 1, 0)  # at the first time, only the acceleration and the energies are found
        interval = Interval(times[at], times[at + 1], loads[at], loads[at + 1])
        state = compiled(leaves, state, interval, until, limits)
        found.append(jax.tree.map(np.asarray, state))
        if stopped.is_set() or (not k and np.any(found[0].failed)):
            break
    return jax.tree.map(lambda *parts: np.stack(parts, axis=1), *found)


def _checked(
    robots: Sequence[Robot],
    times: Float[np.ndarray, " times"],
    loads: Float[np.ndarray, "rows channels"] | None,
    q: Float[np.ndarray, "robots dofs"] | None,
    velocity: Float[np.ndarray, "robots dofs"] | None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, loads, and starts (q and velocity); InputError for what cannot be moved."""
    if not robots:
        raise InputError("robots: expected at least one, got none")
    if any(jax.tree.structure(robot) != jax.tree.structure(robots[0]) for robot in robots):
        raise InputError("robots: expected one structure (bodies, bases, points, terms), got several")
    if not robots[0].dofs:
        raise InputError("robots: expected some that can move, got no coordinates")
    times = np.asarray(times, dtype=float)
    if times.ndim != 1 or len(times) < 2 or not np.all(np.isfinite(times)) or np.any(np.diff(times) <= 0):
        raise InputError("times: expected at least two finite, ascending times [s]")
    needed = robots[0].loads
    loads = np.zeros((len(times), 0)) if loads is None else np.asarray(loads, dtype=float)
    if loads.ndim != 2 or len(loads) != len(times) or not np.all(np.isfinite(loads)):
        raise InputError(
            f"loads: expected finite numbers, one row for each of {len(times)} times, got {loads.shape}"
        )
    if loads.shape[1] < needed:
        raise InputError(f"loads: the robot's terms need {needed} channels, got {loads.shape[1]}")
    for clock in robots[0].clocks:
        if not np.allclose(np.diff(loads[:, clock]), np.diff(times), rtol=1e-9, atol=0):
            raise InputError(f"loads: channel {clock} holds the time [s]; expected it to run as `times` does")
    shape = (len(robots), robots[0].dofs)
    starts = [np.zeros(shape) if x is None else np.asarray(x, dtype=float) for x in (q, velocity)]
    for name, start in zip(("q", "velocity"), starts, strict=True):
        if start.shape != shape or not np.all(np.isfinite(start)):
            raise InputError(f"{name}: expected finite numbers of shape {shape}, got {start.shape}")
    return times, loads, np.stack(starts)


def _leaves(robot: Robot) -> list[np.ndarray]:
    return [np.asarray(leaf) for leaf in jax.tree.leaves(robot)]


@lru_cache(maxsize=64)
def _compiled(structure: Hashable) -> Callable:
    """The function that brings every lane to the end of an interval."""

    def one(
        leaves: list[Array],
        state: IntegrationState,
        interval: Interval,
        until: Array,
        limits: StepLimits,
    ) -> IntegrationState:
        return integrate(jax.tree.unflatten(structure, leaves), state, interval, until, limits)

    batched = jax.vmap(one, in_axes=(0, 0, None, None, None))
    return jax.jit(batched, compiler_options={"xla_cpu_multi_thread_eigen": False})
