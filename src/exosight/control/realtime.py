"""The loop in real time: acquire, estimate, control, actuate, in the periods of a clock; at its end u returns
to 0.

acquire   the newest frame of a source; of a simulated plant, rendering
estimate  the network
control   guard and law
actuate   the actuator; of a simulated plant, solving
"""

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from jaxtyping import Float

from exosight.control.actuators import Actuator
from exosight.control.adaptive import Adaptive
from exosight.control.estimator import Read, Reader, Reading, read_one, read_under
from exosight.control.guard import Guarded, Measurement, Problem, State
from exosight.control.paths import ControllerConfig, limited
from exosight.control.sources import Frame, Source
from exosight.errors import InputError

_ROUND_OFF = 1e-6  # of a number of periods
_SENT = 64  # commands remembered, for frames that come late
STAGES = ("acquire", "estimate", "control", "actuate")


@dataclass(frozen=True, eq=False)
class Step:
    """One step of the loop as it happened.

    time     since the first step began [s]
    target   of the controlled sensor [its unit]
    measurement  that the guard got
    true     (outputs,)  true readings of the estimated sensors [each in its unit]; None: unknown
    command  that was asked for [the driven channel's unit]
    state    of the guard after it
    cause    of a change of state in this step; empty if there was none
    seconds  (4,)  that the STAGES took [s]
    late     how long after its time the step began [s]
    problem  of the measurement; None if there is none
    missed   periods since the last step in which there was none
    shown    (channels,)  commands under which the frame was taken, as the plant reports them, else by its
             time [each in its channel's unit]; None: no frame came
    """

    time: float
    target: float
    measurement: Measurement
    true: Float[np.ndarray, " outputs"] | None
    command: float
    state: State
    cause: str
    seconds: Float[np.ndarray, "4"]
    late: float
    problem: Problem | None = None
    missed: int = 0
    shown: Float[np.ndarray, " channels"] | None = None


@dataclass(frozen=True)
class Clock:
    """Seconds since some moment that never jump, and a way to let them pass."""

    now: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep


REAL_TIME = Clock()


def run_live(
    source: Source,
    network: Reader | Read,
    guarded: Guarded | Adaptive,
    actuator: Actuator,
    target: Iterable[float],
    done: Callable[[Step], None] = lambda step: None,
    clock: Clock = REAL_TIME,
) -> int:
    """Follow a target until it ends or the source does, one step in each period of the clock.

    Period k begins k periods after the first one. A step that takes longer than its period leaves out those
    that began meanwhile: they are missed, their targets too, u stays, and the next step begins with a period
    again. So a target of 600 periods of 0.1 s ends after 60 s, however long the steps take. Whatever ends
    the loop, an exception of anyone and Ctrl-C included, u first returns to 0 at the rate limit; a second
    Ctrl-C cuts that short, and leaves the rest to `Actuator.close`.

    network  that reads the frames; one that takes commands gets those under which a frame was taken
    target   of each period [the controlled sensor's unit], a finite number; `itertools.repeat(0.2)` goes on
             until it is stopped
    done     called with every step; what it raises ends the loop
    returns  how many periods at the end of the target were missed; those before are told by the steps
    """
    guarded.reset()
    period, u, slot, missed = guarded.config.period, 0.0, -1, 0
    targets, sent = iter(target), deque([(-math.inf, 0.0)], maxlen=_SENT)
    try:
        actuator.apply(u)
        begin = clock.now() + period
        while True:
            ahead = list(islice(targets, missed + 1))
            if len(ahead) <= missed:
                return len(ahead)
            slot += missed + 1
            due = begin + slot * period
            clock.sleep(max(0.0, due - clock.now()))
            started = clock.now()
            try:
                frame = next(source)
            except StopIteration:
                return 0
            seen = clock.now()
            shown = None if frame is None else _shown(frame, guarded.config, sent)
            reading = None
            if frame is not None and shown is not None:
                reading = read_one(read_under(network, shown), frame.image)
            estimated = clock.now()
            measurement = Measurement() if frame is None else _measurement(frame, reading, estimated)
            changes, force = len(guarded.log), ahead[-1]
            u = guarded.step(force, measurement, missed)
            decided = clock.now()
            sent.append((decided, u))
            actuator.apply(u)
            done(
                Step(
                    time=started - begin,
                    target=float(force),
                    measurement=measurement,
                    true=None if frame is None else frame.outputs,
                    command=u,
                    state=guarded.state,
                    cause=guarded.log[-1].cause if len(guarded.log) > changes else "",
                    problem=guarded.problem,
                    seconds=np.diff([started, seen, estimated, decided, clock.now()]),
                    late=started - due,
                    missed=missed,
                    shown=shown,
                )
            )
            passed = (clock.now() - begin) / period - slot  # periods since this one began
            missed = max(0, math.ceil(passed - _ROUND_OFF) - 1)
    finally:
        _let_go(guarded, actuator, u, clock)


def _measurement(frame: Frame, reading: Reading | None, now: float) -> Measurement:
    return Measurement(frame.image, reading, age=now - frame.time, commands=frame.commands)


def _shown(
    frame: Frame, config: ControllerConfig, sent: Sequence[tuple[float, float]]
) -> Float[np.ndarray, " channels"]:
    """The commands under which a frame was taken.

    sent  times at which u was sent, rising [s], and u
    """
    if frame.commands is not None:
        return frame.commands
    before = (u for time, u in reversed(sent) if time <= frame.time)
    return config.commands(next(before, sent[0][1]))


def _let_go(guarded: Guarded | Adaptive, actuator: Actuator, u: float, clock: Clock) -> None:
    while u != 0:
        clock.sleep(guarded.config.period)
        u = limited(guarded.config, u, 0.0)
        actuator.apply(u)


@dataclass(frozen=True)
class Timing:
    """How long a stage took, over all steps [s]."""

    stage: str
    p50: float
    p99: float
    largest: float


def timings(seconds: Float[np.ndarray, "steps 4"]) -> tuple[Timing, ...]:
    """Of each stage, and of the whole step, which is from asking for a frame to the actuator.

    Raises InputError if there is no step.
    """
    if not len(seconds):
        raise InputError("timings: expected at least one step, got none")
    columns = np.column_stack([seconds, seconds.sum(axis=1)])
    values = np.quantile(columns, [0.5, 0.99, 1.0], axis=0)
    return tuple(
        Timing(stage, *(float(value) for value in values[:, i]))
        for i, stage in enumerate((*STAGES, "whole step"))
    )
