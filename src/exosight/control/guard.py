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

import math
from collections import deque
from dataclasses import dataclass, field
from enum import Enum
from numbers import Real
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as configuration

from exosight.control.estimator import Reading, is_frame, shown_score
from exosight.control.paths import ControllerConfig, limited
from exosight.control.scheduled import RELEASED, Scheduled
from exosight.errors import InputError

_LARGEST = 50.0  # [N or rad]: no estimate of a simulated sensor is beyond it
_HISTORY = 64  # actuations remembered, for pictures that come late

_OTHER_NETWORK = "choose another network, one that was trained for this system"
_SHOW = (
    "show the system as the training images do (view, distance, light, background, nothing in front), or "
    "fine-tune the network for this set-up (exosight train --pretrained)"
)
"""What helps against images that the network was not trained for."""

Count = Annotated[int, Field(ge=1, le=1000)]


class State(Enum):
    """What the guard lets the controller do."""

    NORMAL = "normal"
    SLOW = "slow"
    HOLD = "hold"
    RELEASE = "release"


@configuration(frozen=True, config=ConfigDict(extra="forbid"))
class GuardConfig:
    """When a frame is bad or its estimate uncertain, and how long each state lasts."""

    uncertain_ood_score: Annotated[float, Field(gt=0, le=1)] = 0.8
    """OOD score from which on an estimate is uncertain; above 1 the frame is bad [-]"""
    uncertain_width: Annotated[float, Field(gt=0)] = 0.3
    """width of the interval of the controlled sensor from which on an estimate is uncertain [its unit]"""
    max_age: Annotated[float, Field(gt=0)] = 0.5
    """age above which a frame is stale [s]"""
    min_contrast: Annotated[int, Field(ge=1, le=255)] = 10
    """brightest − darkest gray value below which a frame is black or blank"""
    frozen_command_change: Annotated[float, Field(gt=0)] = 0.025
    """change of u, as a share of the channel's peak, under which a frame that stays the same is frozen [-]"""
    frozen_frames: Annotated[int, Field(ge=0, le=1000)] = 0
    """same frames in a row that are frozen whatever u does; 0 for a camera without noise"""
    max_command_error: Annotated[float, Field(gt=0)] = 0.025
    """difference of the plant's u from the one asked for, as a share of the channel's peak, from which on it
    does not follow [-]"""
    overload: Annotated[float, Field(ge=1)] = 1.25
    """share of its limit above which an output is too large"""
    bad_frames: Count = 2
    """bad frames in a row that lead to HOLD, and from there to RELEASE; u stays at the first already"""
    hold_steps: Count = 5
    """steps in HOLD after which bad frames in a row lead to RELEASE"""
    good_frames: Count = 5
    """good frames in a row that lead out of HOLD, RELEASE and SLOW"""
    limit_steps: Count = 20
    """steps in a row at the largest u and yet below the target that are uncertain"""
    slow: Annotated[float, Field(gt=0, le=1)] = 0.25
    """share of the law's step that SLOW lets load"""


@dataclass(frozen=True, eq=False)
class Measurement:
    """What was measured in one step; all of it may be missing or wrong, of any type: the guard judges it.

    image    (height, width)  uint8 gray 0…255; None: no frame came
    reading  what the estimator read off it, one row; None: there is no estimate
    age      of the frame [s]
    commands (channels,)  that the plant reports with the frame [each in its unit]; None: it reports none
    """

    image: Any = None
    reading: Any = None
    age: Any = 0.0
    commands: Any = None

    def sum(self, weights: Float[np.ndarray, " outputs"]) -> float:
        """weights · outputs as they were read; NaN if nothing was, or no such outputs."""
        if not _is_reading(self.reading, len(weights)):
            return math.nan
        with np.errstate(all="ignore"):
            return float((self.reading.forces[0] * weights.astype(np.float32)).sum())


@dataclass(frozen=True)
class Problem:
    """What is wrong with a measurement.

    cause    in words, with its numbers
    remedy   what would help
    """

    cause: str
    remedy: str


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
        self._channel = self.config.schema.channel_index(self.config.channel)
        measured = [spec.quantity == "measurement" for spec in self.config.schema.estimated]
        self._largest = np.where(measured, np.inf, _LARGEST)
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
        self._steps = self._bad = self._good = self._reliable = self._inside = self._at_limit = self._same = 0
        self._past: deque[float] = deque([0.0], maxlen=_HISTORY)
        self._frame: np.ndarray | None = None
        self._frame_u = 0.0

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
        self._past.extend([self._past[-1]] * min(missed, _HISTORY))
        fault = self._fault(measurement)
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
        u = self._past[-1]
        if self.state is State.RELEASE:
            wanted = 0.0
        elif self.state is State.HOLD or outputs is None:
            wanted = u
        else:
            reported = self._reported(measurement)
            at = self._command_at(measurement.age) if reported is None else reported
            wanted = self.law.next(target, self.config.sum(outputs), outputs, at)
            if self.state is State.SLOW and wanted > max(u, 0.0):
                wanted = u + self.guard.slow * (wanted - u)
        # Whatever happens above, the limits hold.
        u = limited(self.config, u, wanted)
        self.law.track(u)
        self._past.append(u)
        return u

    def _reported(self, measurement: Measurement) -> float | None:
        """The command of the driven channel as the plant reports it."""
        return None if measurement.commands is None else float(measurement.commands[self._channel])

    def _command_at(self, age: float) -> float:
        """The command of that long ago."""
        back = round(min(age / self.config.period, len(self._past) - 1))
        return self._past[-1 - back]

    def _fault(self, measurement: Measurement) -> Problem | None:
        """Why this frame is bad; None if it is not."""
        guard, image, reading = self.guard, measurement.image, measurement.reading
        if image is None:
            return Problem("no frame", "check that the camera is connected and used by no other program")
        if not is_frame(image):
            return Problem("a frame that is no gray image", "let the camera give 8-bit gray images")
        age = _number(measurement.age)
        if not 0 <= age <= guard.max_age:
            remedy = "use a camera or connection with less delay, or end other programs"
            return Problem(f"a stale frame, {age:.2f} s old", remedy)
        if int(image.max()) - int(image.min()) < guard.min_contrast:
            return Problem("a black or blank frame", "uncover the lens, light the scene, check the exposure")
        driven, then = self.config.driven, self._command_at(age)
        if self._is_frozen(image, then):
            remedy = "restart the camera, and check that the actuator moves the system"
            return Problem("a frozen frame, identical to the last", remedy)
        channels = len(self.config.schema.channels)
        if measurement.commands is not None and not _is_array(measurement.commands, "fiu", (channels,)):
            remedy = "let the plant report one number a channel, or none"
            return Problem("the plant reports no commands of its channels", remedy)
        reported = self._reported(measurement)
        if reported is not None and not abs(reported - then) <= guard.max_command_error * driven.peak:
            at = f"{driven.name} = {reported:.2f} {driven.unit}"
            remedy = "check the actuator's supply and connection"
            return Problem(f"the plant reports {at}, not the command that was sent", remedy)
        if reading is None:
            return Problem("no estimate", _OTHER_NETWORK)
        if not _is_reading(reading, len(self.config.weights)):
            return Problem("an estimate of another shape", _OTHER_NETWORK)
        rows = np.concatenate([reading.forces, reading.low, reading.high])
        # NaN fails in each of these.
        if not (np.abs(rows) <= self._largest).all() or not (rows[1] <= rows[2]).all():
            return Problem("an estimate that is no valid reading", _OTHER_NETWORK)
        if not reading.ood_score[0] <= 1:
            return Problem(f"an out-of-distribution image, score {_score(reading)}", _SHOW)
        return None

    def _is_frozen(self, image: np.ndarray, then: float) -> bool:
        """Whether the picture is the last one again although u was another when it was taken."""
        if self._frame is None or self._frame.shape != image.shape or (self._frame != image).any():
            self._frame, self._frame_u, self._same = image.copy(), then, 0
            return False
        self._same += 1
        moved = abs(then - self._frame_u) >= self.guard.frozen_command_change * self.config.driven.peak
        return moved or 0 < self.guard.frozen_frames <= self._same

    def _uncertainty(
        self, measurement: Measurement, target: float, outputs: np.ndarray | None
    ) -> Problem | None:
        """Why the estimate is uncertain; None if it is reliable."""
        if outputs is None or measurement.reading is None:
            return Problem("no estimate", _OTHER_NETWORK)
        short = self.config.sum(outputs) < target and self._past[-1] >= self.config.u_max
        self._at_limit = self._at_limit + 1 if short else 0
        reading, config = measurement.reading, self.config
        width = float(((reading.high - reading.low)[0] * config.weights.astype(np.float32)).sum())
        if width >= self.guard.uncertain_width:
            cause = f"an uncertain estimate, an interval of {width:.2f} {config.controlled.unit}"
            return Problem(cause, _SHOW)
        if float(reading.ood_score[0]) >= self.guard.uncertain_ood_score:
            return Problem(f"an image close to out of distribution, score {_score(reading)}", _SHOW)
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
        guard, state, at_rest = self.guard, self.state, self._past[-1] == 0
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


def _score(reading: Reading) -> str:
    return f"{shown_score(reading.ood_score[0]):.3f}"


def _number(value: object) -> float:
    """A number as it is, and NaN for whatever is none."""
    try:
        return float(value) if isinstance(value, Real) else math.nan
    except OverflowError:
        return math.nan


def _is_array(value: object, kinds: str, shape: tuple[int, ...]) -> bool:
    """Whether it is an array of such a shape and of numbers of one of these kinds, as NumPy names them."""
    return isinstance(value, np.ndarray) and value.dtype.kind in kinds and value.shape == shape


def _is_reading(value: object, outputs: int) -> bool:
    """Whether it is what is read off one image, of so many outputs."""
    return (
        isinstance(value, Reading)
        and all(
            _is_array(row, "f", (1, outputs)) for row in (value.forces, value.low, value.high, value.contact)
        )
        and _is_array(value.ood_score, "f", (1,))
    )
