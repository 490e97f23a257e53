"""A controller that follows its observer, and whose authority depends on how much the observer knows.

    authority  u                                              while the last frame that was taken in is
    NORMAL     to where the observer has the target           at most 0.6 s old, and the force is known
    SLOW       loads at half of that, on the prediction       at most 1.2 s old
    HOLD       stays, or unloads to within the limits         at most 2.2 s old
    RELEASE    → 0 at the full rate, open loop                older, or an output is beyond its limit by a
                                                              quarter in two frames

A frame that is lost, spoilt or an outlier costs nothing but time: no state is left because of one. Towards
more authority it goes after two frames in a row that the observer took in; out of RELEASE after five, at
u = 0. Whatever happens, u is limited in amplitude and rate, and without frames it is 0 after 2.2 s and
u_max divided by the rate. A target of 0 needs no frame: u goes to 0.

No single frame leads to more force alone. Where the last frame, or the state before it, asks for less than
the observer, u is the lower one until a frame agrees: a frame that is sent twice, the second time as a new
one, reads too little for its age, and nothing tells if the first one was lost. An output that is read beyond
its limit lowers u also where the observer takes the frame for an outlier. Loading is slow where the force
that it leads to is not well known, or states disagree; where it is known least, it waits for a frame that was
made under the present command.
"""

import math
from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as configuration

from exosight.control.frame_check import FrameCheck, GuardConfig, Measurement, Problem
from exosight.control.guard import State, Transition
from exosight.control.observer import Observer, ObserverConfig
from exosight.control.paths import ControllerConfig, limited
from exosight.control.scheduled import RELEASED
from exosight.errors import InputError

_LEVEL = 3.29  # width of the 90 % interval of a normal distribution in standard deviations
_NOISE = 2.0  # standard deviations by which a noisy frame may read too much
_OVERLOADS = 2  # frames in a row: a single one may be noise


@configuration(frozen=True, config=ConfigDict(extra="forbid"))
class AuthorityConfig:
    """How long, and how uncertain, the controller may act."""

    slow_seconds: Annotated[float, Field(gt=0, le=10)] = 0.6
    """time without a frame after which loading slows down [s]"""
    hold_seconds: Annotated[float, Field(gt=0, le=10)] = 1.2
    """time after which u stays [s]"""
    release_seconds: Annotated[float, Field(gt=0, le=10)] = 2.2
    """time after which it is released [s]"""
    slow_deviation: Annotated[float, Field(gt=0, le=1)] = 0.06
    """standard deviation of the controlled sensor from which loading slows down, as a share of its largest
    reading on the path [-]"""
    slow: Annotated[float, Field(gt=0, le=1)] = 0.5
    """share of the step that SLOW lets load"""
    wait_deviation: Annotated[float, Field(gt=0, le=1)] = 0.1
    """the same from which on it loads on only after a frame that was made under the present command [-]"""
    frames_up: Annotated[int, Field(ge=1, le=100)] = 2
    """frames in a row that lead to more authority"""
    frames_back: Annotated[int, Field(ge=1, le=100)] = 5
    """frames in a row that lead out of RELEASE"""


@configuration(frozen=True, config=ConfigDict(extra="forbid"))
class AdaptiveConfig:
    """Settings of the adaptive controller."""

    authority: AuthorityConfig = AuthorityConfig()
    """how long it may act on predictions"""
    observer: ObserverConfig = ObserverConfig()
    """what is known before"""


class Adaptive:
    """Observer, law and authority in one: `step` answers any measurement with u within its limits.

    config     limits and solved paths, from `exosight.control.tuning.tune`
    adaptive   its settings
    guard      when a frame is bad; of its numbers those count that say so
    """

    def __init__(
        self,
        config: ControllerConfig,
        adaptive: AdaptiveConfig | None = None,
        guard: GuardConfig | None = None,
    ) -> None:
        self.config, self.adaptive = config, adaptive or AdaptiveConfig()
        self.guard, self.observer = guard or GuardConfig(), Observer(config, self.adaptive.observer)
        self._frames = FrameCheck(config, self.guard)
        self._largest = float(config.loading.controlled.max())
        self.log: list[Transition] = []
        self.reset()

    def reset(self) -> None:
        """Return to the initial state, at u = 0."""
        self.observer.reset()
        self._frames.reset()
        self.state, self.problem = State.NORMAL, None
        self.log = []
        self._steps = self._good = self._over = 0
        self._found = Measurement()
        self._bound = math.inf  # of u, by the outputs that the last frame read
        self._others: list[np.ndarray] = []  # states by which u is lower, see `_doubt`
        self._behind = 0  # steps from the observer's state to the coming command
        self._unseen = 0  # the same from the last frame that it took in
        self._seen = 0.0  # u under which that was made

    def step(self, target: float, measurement: object, missed: int = 0) -> float:
        """The command of the coming step [the channel's unit].

        target       of the controlled sensor [its unit]
        measurement  a Measurement; anything else is one without a frame
        missed       periods since the last step in which there was none, and u stayed

        Raises InputError if the target is no finite number.
        """
        _check(target)
        self.observe(measurement, missed)
        return self.command(target)

    def observe(self, measurement: object, missed: int = 0) -> None:
        """Take in what was measured, the first half of `step`; arguments as there."""
        found = measurement if isinstance(measurement, Measurement) else Measurement()
        self._found = found
        self._steps += 1
        self._frames.sent(self._frames.u, missed)
        self._behind += 1 + missed
        self._unseen += 1 + missed
        self.problem = self._frames.fault(found)
        if self.problem is not None:
            self._good = 0
        elif self._frames.repeated:
            # It may have been sent once more, as a new one; a second one says that nothing has changed.
            self.problem = Problem("a frame identical to the last", "look at the pictures of this moment")
        else:
            self._observe(found)
        self._decide()

    def command(self, target: float) -> float:
        """The command of the coming step [the channel's unit], the second half of `step`.

        target   of the controlled sensor [its unit]

        Raises InputError if the target is no finite number.
        """
        _check(target)
        u = self._frames.u
        wanted = self._wanted(float(target), u, self._found)
        u = limited(self.config, u, wanted)
        self._frames.sent(u)
        return u

    @property
    def unseen(self) -> float:
        """Time since the last frame that the observer took in was made [s]."""
        return self._unseen * self.config.period

    def _observe(self, found: Measurement) -> None:
        """Let the observer take in a good frame."""
        reading, config = found.reading, self.config
        outputs = reading.forces[0].astype(float)
        over = bool((outputs > self.guard.overload * config.output_limits).any())
        self._over = self._over + 1 if over else 0
        late = round(found.age / config.period) + 1  # the frame was made at the end of the step before
        if late > self._behind:
            return  # older than one that was taken in
        width = float(((reading.high - reading.low)[0] * config.weights).sum())
        self.observer.advance(self._behind - late)
        self._behind = late
        u = self._frames.command_of(found)
        before, _ = self.observer.ahead(0)
        noise = math.sqrt(self.observer.scatter(u, outputs))
        if self.observer.update(u, outputs, width / _LEVEL):
            self._good, self._unseen, self._seen = self._good + 1, late, u
        else:
            self._good = 0
            self.problem = Problem("an outlier", "look at the pictures of this moment")
        self._bound = self._bound_by(u, outputs)
        self._others = [before, *self._alone(u, config.sum(outputs) - _NOISE * noise)]

    def _bound_by(self, u: float, outputs: Float[np.ndarray, " outputs"]) -> float:
        """The largest command by what was read under u: lower, as far as some output is beyond its limit."""
        excess = float((outputs - self.config.output_limits).max())
        return u - self.config.largest_gain * excess if excess > 0 else math.inf

    def _alone(self, u: float, measured: float) -> list[np.ndarray]:
        """The state that one frame alone says; none where nothing presses, as the path has no inverse there.

        measured  the least that the controlled sensor reads under u, by the frame
        """
        if measured < RELEASED:
            return []
        x = self.observer.ahead(0)[0].copy()
        x[1] = self.observer.shifts_of(x, np.array([u]), np.array([measured]))[0]
        return [x]

    def _doubt(self, target: float) -> float:
        """By how much u is lower than the observer would have it for a target.

        It is that of the lowest of three states: the observer's, its own before the last frame, and that
        which this frame alone says; a difference of half of what plants differ by is not counted.
        """
        if not self._others:
            return 0.0
        now, *others = (
            self.observer.command_of(x, target) for x in (self.observer.ahead(0)[0], *self._others)
        )
        return max(now - min(others) - self._usual, 0.0)

    @property
    def _usual(self) -> float:
        """By how much plants differ anyway: half a standard deviation of d [the channel's unit]."""
        return self.adaptive.observer.shift * abs(self.config.driven.peak) / 2

    def _decide(self) -> None:
        """Authority, by what is known of the present."""
        limits, unseen = self.adaptive.authority, self.unseen
        if self._over >= _OVERLOADS:
            return self._go(State.RELEASE, "an output beyond its limit by a quarter")
        if unseen > limits.release_seconds + _ROUND_OFF:
            return self._go(State.RELEASE, f"no frame for {unseen:.1f} s")
        if self.state is State.RELEASE:
            if self._frames.u == 0 and self._good >= limits.frames_back:
                self._go(State.SLOW, f"{self._good} frames in a row")
            return None
        if unseen > limits.hold_seconds + _ROUND_OFF:
            return self._go(State.HOLD, f"no frame for {unseen:.1f} s")
        unit = self.config.controlled.unit
        if unseen > limits.slow_seconds + _ROUND_OFF:
            asked, cause = State.SLOW, f"no frame for {unseen:.1f} s"
        elif (deviation := self._deviation(self._frames.u)) > limits.slow_deviation:
            asked, cause = State.SLOW, f"a force known to {deviation * self._largest:.3f} {unit}"
        else:
            asked, cause = State.NORMAL, f"{self._good} frames in a row"
        more = _ORDER.index(asked) < _ORDER.index(self.state)
        if not more or self._good >= limits.frames_up:
            self._go(asked, cause)
        return None

    def _go(self, state: State, cause: str) -> None:
        if state is not self.state:
            self.log.append(Transition(self._steps, self.state, state, cause))
            self.state = state

    def _wanted(self, target: float, u: float, found: Measurement) -> float:
        """The command to go to, before amplitude and rate are limited."""
        if self.state is State.RELEASE:
            return 0.0
        if target < RELEASED:
            return self._release(u, found)
        config, ahead = self.config, self._behind
        target = config.reachable(target)
        doubt = self._doubt(target)
        largest = min(max(self.observer.largest(ahead) - doubt, 0.0), self._bound)
        if self.state is State.HOLD:
            return min(u, largest)
        wanted = min(self._aim(target, ahead) - doubt, largest)
        if wanted <= max(u, 0.0):
            return wanted
        return self._loaded(u, min(wanted, u + config.step), certain=doubt <= self._usual)

    def _loaded(self, u: float, wanted: float, certain: bool) -> float:
        """The command on the way up to a wanted one that what is known allows."""
        limits = self.adaptive.authority
        certain = certain and self.state is State.NORMAL
        if not certain or self._deviation(wanted) > limits.slow_deviation:
            wanted = u + limits.slow * (wanted - u)
        waits = self._seen < u - self.config.margin and self._deviation(wanted) > limits.wait_deviation
        return u if waits else wanted

    def _deviation(self, u: float) -> float:
        """How well the force under a command is known, as a share of its largest."""
        return self.observer.predict(u, self._behind).deviation / self._largest

    def _aim(self, target: float, ahead: int) -> float:
        """The command at which the sensor reads the target, so many steps after the last frame."""
        return self.observer.command(target, ahead)

    def _release(self, u: float, found: Measurement) -> float:
        """To 0, and if it presses there as well on to u_min, then slowly back, lest it closes again."""
        if u > 0:
            return 0.0
        if self.problem is None:
            at = self._frames.command_of(found)
            # The lower end of the interval: a network reads a few mN where nothing presses.
            surely = float((found.reading.low[0] * self.config.weights).sum())
            if surely >= RELEASED:
                return 0.0 if at > 0 else self.config.u_min
        return min(u + 0.1 * self.config.step, 0.0)


def _check(target: float) -> None:
    if not np.isfinite(target):
        raise InputError(f"target: expected a finite number, got {target}")


_ORDER = (State.NORMAL, State.SLOW, State.HOLD, State.RELEASE)
_ROUND_OFF = 1e-9  # of times that are sums of periods [s]
