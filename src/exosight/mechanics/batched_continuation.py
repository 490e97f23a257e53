"""Many robots side by side, in lanes of compiled code (`lanes`) on every core."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, Protocol, runtime_checkable

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from exosight.cpu import cores
from exosight.mechanics.compiled_lanes import Common
from exosight.mechanics.continuation_records import Records
from exosight.mechanics.continuation_state import SNAPS, OfLoad, OfSnap
from exosight.mechanics.equilibrium import SolverOptions
from exosight.mechanics.lanes import Lanes, Problems, Queue
from exosight.mechanics.packing import Packing
from exosight.mechanics.prepared import Settings, prepared

ROOM = 1, 32
"""Loads that a lane takes at a time, for single loads and for paths; longer ones go on in the same lane.

Two numbers, so at most two compilations: the robot's Hessian at each (5 KiB for the published exosuit) goes
in and out of the compiled code, which a controller that asks for one load at a time would wait for."""


class Snap(NamedTuple):
    """One jump of a robot on its path, from the end of a stable branch to another stable equilibrium.

    step      index of the first load beyond it
    load      (channels,)   where the branch ends [N]
    before    (dofs,)       the pose just before
    after     (dofs,)       the pose at `load` that the jump leads to
    energy    what the jump sets free: Π of the pose left − Π of the pose reached [J]
    taken     what friction took of it [J]; the rest is lost to the flow between the two
    """

    step: int
    load: Float[np.ndarray, " channels"]
    before: Float[np.ndarray, " dofs"]
    after: Float[np.ndarray, " dofs"]
    energy: float
    taken: float


class Solutions(NamedTuple):
    """What was found, of shape (robots, loads, …); see `Equilibria`. `load`: where each robot was [N].

    supplied, dissipated   until all robots are finished, of each load alone
    """

    q: Float[np.ndarray, "robots loads dofs"]
    load: Float[np.ndarray, "robots loads channels"]
    converged: Bool[np.ndarray, "robots loads"]
    residual: Float[np.ndarray, "robots loads"]
    min_eigenvalue: Float[np.ndarray, "robots loads"]
    snapped: Bool[np.ndarray, "robots loads"]
    tied: Bool[np.ndarray, "robots loads"]
    energy: Float[np.ndarray, "robots loads"]
    supplied: Float[np.ndarray, "robots loads"]
    dissipated: Float[np.ndarray, "robots loads"]
    iterations: Int[np.ndarray, "robots loads"]
    history: tuple[Float[np.ndarray, "robots loads ..."], ...]
    snaps: list[list[Snap]]


_AS_RECORDED = tuple(name for name in OfLoad._fields if name != "memories")


@runtime_checkable
class Kept(Protocol):
    """What keeps the robots that are finished, so that a solve which was stopped goes on with the others."""

    def restore(self, found: Solutions) -> list[int]:
        """Put into the rows of `found` what is kept, all but `snaps`; returns the robots' numbers."""
        ...

    def finished(self, number: int, found: Solutions) -> None:
        """The row of one more robot is final; called from several threads, which write the other rows."""
        ...


def solve(
    common: Common,
    arrays: Float[np.ndarray, "robots numbers"],
    problems: Problems,
    options: SolverOptions,
    done: Callable[[int], None] = lambda robots: None,
    kept: Kept | None = None,
) -> Solutions:
    """Every robot brought to its loads, one after the other.

    arrays   all arrays of each robot
    done     called with the number of robots finished, as they finish
    kept     what an earlier solve of the same problems finished, and keeps what this one does
    """
    robots, loads = problems.loads.shape[:2]
    on_cpu = jax.default_backend() == "cpu"
    # As suits the device (eight share the cache of a core), but no more than the robots fill.
    lanes = min(options.lanes or (8 if on_cpu else 2048), 1 << max(0, robots - 1).bit_length())
    ready = prepared(common, Settings(lanes, ROOM[loads > ROOM[0]], options.unrolled), arrays)
    found = _nothing(problems)
    restored = kept.restore(found) if kept else []
    if restored:
        done(len(restored))
    queue = Queue(ready, _in_order(problems, set(range(robots)) - set(restored)))

    def finished(number: int) -> None:
        if kept:
            kept.finished(number, found)
        done(1)

    def work() -> None:
        _fill_lanes(problems, options, queue, found, finished)

    # Compiled calls release Python's lock, so one thread a core keeps every core busy.
    workers = min(cores(), -(-robots // lanes)) if on_cpu else 1
    if workers == 1:
        work()
    else:
        with ThreadPoolExecutor(max_workers=workers) as pool:
            try:
                for future in [pool.submit(work) for _ in range(workers)]:
                    future.result()
            except BaseException:  # Ctrl-C too: the pool waits for its threads, which need not finish
                queue.stopped = True
                raise
    for of_each in (found.supplied, found.dissipated):
        np.cumsum(of_each, axis=1, out=of_each)
    return found


def _in_order(problems: Problems, numbers: set[int]) -> list[int]:
    """Robots on the way to single loads in the order of how far that is: a long one taken last would be
    waited for with all other lanes idle.
    """
    order = sorted(numbers)
    if problems.loads.shape[1] > 1 or len(order) == 1:
        return order
    far = np.linalg.norm(problems.loads[:, 0] - problems.origin, axis=1)
    return sorted(order, key=lambda number: -far[number])


def _fill_lanes(
    problems: Problems,
    options: SolverOptions,
    queue: Queue,
    found: Solutions,
    finished: Callable[[int], None],
) -> None:
    """The work of one thread: so many lanes, each given another robot once it is done, until none waits.

    finished   called with the number of every robot that is
    """
    lanes, room, _ = queue.robots.settings
    code, loads = queue.robots.code, problems.loads.shape[1]
    taken, rows = queue.take(lanes)
    if not len(taken):
        return
    lane = Lanes(problems, options, lanes, code, taken, rows)
    now = lane.now
    while np.any(lane.number >= 0) and not queue.stopped:
        # While robots or further loads wait, come back as soon as some lanes are free for them: for single
        # loads, which take a few evaluations, half of the lanes, else a quarter.
        free = int(np.count_nonzero(lane.number < 0))
        waiting = queue.waiting() or loads > room
        lane.advance(min(lanes, free + max(1, lanes // (2 if room == ROOM[0] else 4))) if waiting else lanes)
        arrived = (now.load == lane.total) & (lane.number >= 0)
        snaps = np.minimum(now.snaps, SNAPS).astype(int)
        told = (arrived | (snaps >= SNAPS)) & (lane.number >= 0)
        now.snaps[told] = 0
        told &= snaps > 0
        records = Records(*map(np.asarray, lane.records))
        if told.any():
            there = code.layout.own.of_snap.unpack(records.snaps)
            _keep_snaps(found, there, lane, np.flatnonzero(told), snaps)
        at = np.flatnonzero(arrived)
        if not len(at):
            continue
        _keep(found, records, code.layout.own.of_load, lane, at, options.eigenvalues)
        over = lane.first[at] + lane.total[at] == loads
        for number in lane.number[at[over]].tolist():
            finished(number)
        if not over.all():
            lane.go_on(at[~over], found.q, found.load, found.history)
        taken, rows = queue.take(int(np.count_nonzero(over)))
        if len(taken):
            lane.put(at[over][: len(taken)], taken, rows)
        lane.stand(at[over][len(taken) :])


def _nothing(problems: Problems) -> Solutions:
    shape = problems.loads.shape[:2]

    def flags() -> np.ndarray:
        return np.zeros(shape, bool)

    def numbers() -> np.ndarray:
        return np.zeros(shape)

    return Solutions(
        q=np.zeros((*shape, problems.q.shape[1])),
        load=np.zeros(problems.loads.shape),
        converged=flags(),
        residual=numbers(),
        min_eigenvalue=numbers(),
        snapped=flags(),
        tied=flags(),
        energy=numbers(),
        supplied=numbers(),
        dissipated=numbers(),
        iterations=np.zeros(shape, int),
        history=tuple(np.zeros((*shape, *memory.shape[1:])) for memory in problems.history),
        snaps=[[] for _ in range(shape[0])],
    )


def _keep(
    found: Solutions,
    records: Records,
    of_load: Packing,
    lane: Lanes,
    at: Int[np.ndarray, " some"],
    eigenvalues: bool,
) -> None:
    """What some lanes found at their loads; λ of ∇²Π v = λ M v from the whitened Hessian."""
    first, count = lane.first[at], lane.total[at]
    which = np.repeat(np.arange(len(at)), count)
    along = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    source, into = (at[which], along), (lane.number[at][which], first[which] + along)
    rows_there = records.loads[source]
    there: OfLoad = of_load.unpack(rows_there[:, : of_load.numbers])
    for rows, values in (
        *((getattr(found, name), getattr(there, name)) for name in _AS_RECORDED),
        *zip(found.history, there.memories, strict=True),
    ):
        rows[into] = values
    if not eigenvalues:
        found.min_eigenvalue[into] = np.nan
        return
    whitener = lane.given.robots.whitener[at[which]]
    jacobian = rows_there[:, of_load.numbers :].reshape(whitener.shape)
    whitened = np.asarray(whitener @ jacobian @ np.swapaxes(whitener, 1, 2))
    eigenvalue = _smallest_eigenvalues(whitened)
    found.min_eigenvalue[into] = eigenvalue
    found.converged[into] &= eigenvalue > 0


def _smallest_eigenvalues(matrices: Float[np.ndarray, "some dofs dofs"]) -> Float[np.ndarray, " some"]:
    """The smallest real part of the eigenvalues of each matrix, symmetric up to round-off or not."""
    skew = np.abs(matrices - np.swapaxes(matrices, 1, 2)).max(axis=(1, 2))
    symmetric = skew <= 1e-9 * np.abs(matrices).max(axis=(1, 2))
    if symmetric.all():
        return np.linalg.eigvalsh(matrices)[:, 0]
    found = np.empty(len(matrices))
    found[symmetric] = np.linalg.eigvalsh(matrices[symmetric])[:, 0]
    found[~symmetric] = np.linalg.eigvals(matrices[~symmetric]).real.min(axis=-1)
    return found


def _keep_snaps(
    found: Solutions,
    snaps: OfSnap,
    lane: Lanes,
    at: Int[np.ndarray, " some"],
    count: Int[np.ndarray, " lanes"],
) -> None:
    for lane_at in at.tolist():
        own = [np.array(values[lane_at]) for values in snaps]
        for step, load, before, after, energy, taken in list(zip(*own, strict=True))[: count[lane_at]]:
            found.snaps[lane.number[lane_at]].append(
                Snap(int(lane.first[lane_at] + step), load, before, after, float(energy), float(taken))
            )
