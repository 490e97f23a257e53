"""Which frames a controller acts on, and what it does without: a state machine between camera and actuator.

    state     u                                       left when
    NORMAL    as the law asks                         uncertain → SLOW; 2 bad frames in a row → HOLD
    SLOW      unloads as asked, loads at a quarter    5 reliable frames in a row → NORMAL; 2 bad → HOLD
              of the law's step
    HOLD      stays                                   5 good frames in a row → SLOW; after 5 steps, 2 bad
                                                      frames in a row → RELEASE
    RELEASE   → 0 at the full rate, open loop          at u = 0, after 5 good frames in a row → SLOW

From every other state an output beyond its limit by a quarter leads to RELEASE, and so does a bad frame while
the target is 0. Good frames are counted from the moment the state is entered. The numbers are those of
`GuardConfig`.
"""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from jaxtyping import Float

from exosight.control.frame_check import (
    OTHER_NETWORK,
    SHOW,
    FrameCheck,
    GuardConfig,
    Measurement,
    Problem,
    score_of,
)
from exosight.control.paths import ControllerConfig, limited
from exosight.control.scheduled import RELEASED, Scheduled
from exosight.errors import InputError


class State(Enum):
    """What the guard lets the controller do."""

    NORMAL = "normal"
    SLOW = "slow"
    HOLD = "hold"
    RELEASE = "release"


@dataclass(frozen=True)
class Transition:
    """One change of state, and why.

    step  of the loop, from 1
    """

    step: int
    before: State
    after: State
    cause: str


@dataclass
class Guarded:
    """A law behind its guard: `step` answers any measurement with a u within amplitude and rate limits.

    law     of control in the states NORMAL and SLOW
    guard   its settings
    log     every change of state since the reset
    problem  of the last measurement, which keeps the law from acting freely; None: there is none
    """

    law: Scheduled
    guard: GuardConfig = field(default_factory=GuardConfig)
    state: State = field(init=False, default=State.NORMAL)
    log: list[Transition] = field(init=False, default_factory=list)
    problem: Problem | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self._frames = FrameCheck(self.config, self.guard)
        self.reset()

    @property
    def config(self) -> ControllerConfig:
        """Limits and paths."""
        return self.law.config

    @property
    def release_time(self) -> float:
        """Longest time from RELEASE to u = 0 [s]."""
        steps = np.ceil(max(self.config.u_max, -self.config.u_min) / self.config.step)
        return float(steps) * self.config.period

    def reset(self) -> None:
        """Return to the initial state, at u = 0."""
        self.law.reset()
        self.state, self.log, self.problem = State.NORMAL, [], None
        self._steps = self._bad = self._good = self._reliable = self._inside = self._at_limit = 0
        self._frames.reset()

    def step(
        self, target: float | Float[np.ndarray, " outputs"], measurement: object, missed: int = 0
    ) -> float:
        """The command of the coming step [the channel's unit].

        target    of the controlled sensor [its unit], or (outputs,) one for each estimated sensor
        measurement   a Measurement; anything else is one without a frame
        missed    periods since the last step in which there was none, and u stayed

        Raises InputError if the target is no finite number.
        """
        if not np.isfinite(target).all():
            raise InputError(f"target: expected finite numbers, got {target}")
        goal = self.config.sum(target) if isinstance(target, np.ndarray) else float(target)
        if not isinstance(measurement, Measurement):
            measurement = Measurement()
        self._steps += 1
        self._inside += 1
        self._frames.sent(self._frames.u, missed)
        fault = self._frames.fault(measurement)
        outputs = (
            None if fault or measurement.reading is None else measurement.reading.forces[0].astype(float)
        )
        uncertain = fault or self._uncertainty(measurement, goal, outputs)
        overload = self._overload(outputs)
        self.problem = overload or uncertain
        self._bad = self._bad + 1 if fault else 0
        self._good = 0 if fault else self._good + 1
        self._reliable = 0 if uncertain else self._reliable + 1
        self._change(goal < RELEASED, fault, uncertain, overload)
        u = self._frames.u
        if self.state is State.RELEASE:
            wanted = 0.0
        elif self.state is State.HOLD or outputs is None:
            wanted = u
        else:
            at = self._frames.command_of(measurement)
            wanted = self.law.next(target, self.config.sum(outputs), outputs, at)
            if self.state is State.SLOW and wanted > max(u, 0.0):
                wanted = u + self.guard.slow * (wanted - u)
        # Whatever happens above, the limits hold.
        u = limited(self.config, u, wanted)
        self.law.track(u)
        self._frames.sent(u)
        return u

    def _uncertainty(
        self, measurement: Measurement, target: float, outputs: np.ndarray | None
    ) -> Problem | None:
        """Why the estimate is uncertain; None if it is reliable."""
        if outputs is None or measurement.reading is None:
            return Problem("no estimate", OTHER_NETWORK)
        short = self.config.sum(outputs) < target and self._frames.u >= self.config.u_max
        self._at_limit = self._at_limit + 1 if short else 0
        reading, config = measurement.reading, self.config
        width = float(((reading.high - reading.low)[0] * config.weights.astype(np.float32)).sum())
        if width >= self.guard.uncertain_width:
            cause = f"an uncertain estimate, an interval of {width:.2f} {config.controlled.unit}"
            return Problem(cause, SHOW)
        if float(reading.ood_score[0]) >= self.guard.uncertain_ood_score:
            return Problem(f"an image close to out of distribution, score {score_of(reading)}", SHOW)
        if self._at_limit >= self.guard.limit_steps:
            largest = f"{config.driven.name}, {config.u_max:.2f} {config.driven.unit}"
            remedy = "choose a smaller target, or check that the system is worn as it was simulated"
            return Problem(f"the target is not reached at the largest {largest}", remedy)
        return None

    def _overload(self, outputs: np.ndarray | None) -> Problem | None:
        """The output that is too large; None if none is."""
        limits = self.config.output_limits
        if outputs is None or not (outputs > self.guard.overload * limits).any():
            return None
        worst = int((outputs / limits).argmax())
        spec = self.config.schema.estimated[worst]
        verb = "presses with" if spec.quantity == "contact force" else "reads"
        remedy = f"choose a smaller target; the limit of {spec.name} is {limits[worst]:g} {spec.unit}"
        return Problem(f"{spec.name} {verb} {outputs[worst]:.2f} {spec.unit}", remedy)

    def _change(
        self, releasing: bool, fault: Problem | None, uncertain: Problem | None, overload: Problem | None
    ) -> None:
        guard, state, at_rest = self.guard, self.state, self._frames.u == 0
        if state is not State.RELEASE:
            if overload:
                return self._go(State.RELEASE, overload.cause)
            if fault and releasing and not at_rest:
                unit = self.config.controlled.unit
                return self._go(State.RELEASE, f"{fault.cause}, and a target of 0 {unit}")
        if state in (State.NORMAL, State.SLOW):
            if fault and self._bad >= guard.bad_frames:
                self._go(State.HOLD, fault.cause)
            elif state is State.NORMAL and uncertain and not fault:
                self._go(State.SLOW, uncertain.cause)
            elif state is State.SLOW and self._reliable >= guard.good_frames:
                self._go(State.NORMAL, f"{self._reliable} reliable frames in a row")
        elif (
            fault
            and state is State.HOLD
            and self._bad >= guard.bad_frames
            and self._inside > guard.hold_steps
        ):
            self._go(State.RELEASE, f"{fault.cause}, after {self._inside - 1} steps of holding")
        elif self._good >= guard.good_frames and (state is State.HOLD or at_rest):
            self._go(State.SLOW, f"{self._good} good frames in a row")

    def _go(self, state: State, cause: str) -> None:
        self.log.append(Transition(self._steps, self.state, state, cause))
        self.state, self._bad, self._good, self._reliable, self._inside = state, 0, 0, 0, 0
