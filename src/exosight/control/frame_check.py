"""What was measured in a step, and whether it can be used: the same checks for every guard."""

import math
from collections import deque
from dataclasses import dataclass
from numbers import Real
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as configuration

from exosight.control.estimator import Reading, is_frame, shown_score
from exosight.control.paths import ControllerConfig

_LARGEST = 50.0  # [N or rad]: no estimate of a simulated sensor is beyond it
_HISTORY = 64  # actuations remembered, for pictures that come late
_ROUND_OFF = 1e-9  # of a number of periods

OTHER_NETWORK = "choose another network, one that was trained for this system"
"""What helps where there is no estimate."""
SHOW = (
    "show the system as the training images do (view, distance, light, background, nothing in front), or "
    "fine-tune the network for this set-up (exosight train --pretrained)"
)
"""What helps against images that the network was not trained for."""

Count = Annotated[int, Field(ge=1, le=1000)]


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
    response_time: Annotated[float, Field(ge=0, le=20)] = 0.0
    """time in which the actuator follows (`Valve.response_time`) [s]: what the plant reports may lie between
    the commands of that long before the frame"""
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
        if not is_reading(self.reading, len(weights)):
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


class FrameCheck:
    """What was sent to the plant and what came back: tells whether a measurement can be used.

    config   limits and schema
    guard    when a frame is bad
    """

    def __init__(self, config: ControllerConfig, guard: GuardConfig) -> None:
        self._config, self._guard = config, guard
        self._channel = config.schema.channel_index(config.channel)
        measured = [spec.quantity == "measurement" for spec in config.schema.estimated]
        self._largest = np.where(measured, np.inf, _LARGEST)
        self.reset()

    def reset(self) -> None:
        """Forget, at u = 0."""
        self._past: deque[float] = deque([0.0], maxlen=_HISTORY)
        self._frame: np.ndarray | None = None
        self._frame_u, self._same = 0.0, 0

    @property
    def u(self) -> float:
        """The command that was sent last [the channel's unit]."""
        return self._past[-1]

    @property
    def repeated(self) -> bool:
        """Whether the last picture is that before it again, which in turn was a new one."""
        return self._same == 1

    def sent(self, u: float, times: int = 1) -> None:
        """Take note of a command, for so many periods."""
        self._past.extend([u] * min(times, _HISTORY))

    def command_of(self, measurement: Measurement) -> float:
        """The command under which something was measured, as the plant reports it, else by its age."""
        reported = self._reported(measurement)
        return self._command_at(measurement.age) if reported is None else reported

    def _reported(self, measurement: Measurement) -> float | None:
        """The command of the driven channel as the plant reports it."""
        return None if measurement.commands is None else float(measurement.commands[self._channel])

    def _command_at(self, age: float) -> float:
        """The command of that long ago."""
        back = round(min(age / self._config.period, len(self._past) - 1))
        return self._past[-1 - back]

    def _has_followed(self, reported: float, age: float) -> bool:
        """Whether a reported command is near one that the actuator may have been at on its way.

        A dead time and a lag lead to means of the commands before, so never beyond all of them.
        """
        slack = self._guard.max_command_error * self._config.driven.peak
        last = len(self._past) - round(min(age / self._config.period, len(self._past) - 1))
        steps = math.ceil(self._guard.response_time / self._config.period - _ROUND_OFF)
        possible = [self._past[i] for i in range(max(last - 1 - steps, 0), last)]
        return min(possible) - slack <= reported <= max(possible) + slack

    def fault(self, measurement: Measurement) -> Problem | None:
        """Why this frame is bad; None if it is not."""
        guard, image, reading = self._guard, measurement.image, measurement.reading
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
        channels = len(self._config.schema.channels)
        if measurement.commands is not None and not _is_array(measurement.commands, "fiu", (channels,)):
            remedy = "let the plant report one number a channel, or none"
            return Problem("the plant reports no commands of its channels", remedy)
        reported, driven = self._reported(measurement), self._config.driven
        # What has not arrived moves nothing: before it does, equal pictures are not frozen ones.
        arrived = math.nan if reported is None else reported
        if self._is_frozen(image, arrived if math.isfinite(arrived) else self._command_at(age)):
            remedy = "restart the camera, and check that the actuator moves the system"
            return Problem("a frozen frame, identical to the last", remedy)
        if reported is not None and not self._has_followed(reported, age):
            at = f"{driven.name} = {reported:.2f} {driven.unit}"
            remedy = "check the actuator's supply and connection"
            return Problem(f"the plant reports {at}, not the command that was sent", remedy)
        if reading is None:
            return Problem("no estimate", OTHER_NETWORK)
        if not is_reading(reading, len(self._config.weights)):
            return Problem("an estimate of another shape", OTHER_NETWORK)
        rows = np.concatenate([reading.forces, reading.low, reading.high])
        # NaN fails in each of these.
        if not (np.abs(rows) <= self._largest).all() or not (rows[1] <= rows[2]).all():
            return Problem("an estimate that is no valid reading", OTHER_NETWORK)
        if not reading.ood_score[0] <= 1:
            return Problem(f"an out-of-distribution image, score {score_of(reading)}", SHOW)
        return None

    def _is_frozen(self, image: np.ndarray, then: float) -> bool:
        """Whether the picture is the last one again although u was another when it was taken."""
        if self._frame is None or self._frame.shape != image.shape or (self._frame != image).any():
            self._frame, self._frame_u, self._same = image.copy(), then, 0
            return False
        self._same += 1
        moved = abs(then - self._frame_u) >= self._guard.frozen_command_change * self._config.driven.peak
        return moved or 0 < self._guard.frozen_frames <= self._same


def score_of(reading: Reading) -> str:
    """Its OOD score in digits."""
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


def is_reading(value: object, outputs: int) -> bool:
    """Whether it is what is read off one image, of so many outputs."""
    return (
        isinstance(value, Reading)
        and all(
            _is_array(row, "f", (1, outputs)) for row in (value.forces, value.low, value.high, value.contact)
        )
        and _is_array(value.ood_score, "f", (1,))
    )
