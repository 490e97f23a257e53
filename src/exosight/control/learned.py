"""The adaptive controller with a learned correction of its command.

    u = d + s U₀(F_t / s) + c π(x),   −1 ≤ π ≤ 1,

where π is a small network that was trained beside a controller that knows plant and user, x what the adaptive
controller knows (`INPUTS`), and c the largest correction. All else is the adaptive controller's: it has the
correction only while its authority is NORMAL or SLOW, and amplitude, rate and the limits of all outputs bound
the sum.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from exosight.control.adaptive import Adaptive, AdaptiveConfig, AuthorityConfig
from exosight.control.frame_check import GuardConfig, Measurement
from exosight.control.paths import ControllerConfig
from exosight.control.scheduled import RELEASED

FRAMES = 6
"""The last frames that are inputs."""
WIDEST = 10.0
"""Of an input: shares, seconds and correlations are of order 1."""
_NEVER = 2.0  # age of a frame that has not come [s]

_STATE = (
    "target [largest reading]",
    "u [peak]",
    "command of the observer − u [peak]",
    "log s [-]",
    "d [peak]",
    "change of d [peak/s]",
    "deviation of log s [-]",
    "deviation of d [peak]",
    "deviation of the change of d [peak/s]",
    "correlation of log s and d [-]",
    "correlation of d and its change [-]",
    "sensitivity [largest reading/peak]",
    "time since the last frame that was taken in [s]",
    "time to predict [s]",
    "time since the start, 1 s at most [s]",
)
_FRAME = (
    "d by its reading alone − d [peak]",
    "age [s]",
    "noise where nothing presses [largest reading]",
    "reading [largest reading]",
    "outlier [-]",
    "its u − u [peak]",
)

INPUTS = (*_STATE, *(f"frame {-i}, {name}" for i in range(1, FRAMES + 1) for name in _FRAME))
"""Of a policy, in order: shares of the channel's peak and of the largest reading of the path."""

FULL_AUTHORITY = AdaptiveConfig(
    authority=AuthorityConfig(
        slow_seconds=10, hold_seconds=10, release_seconds=10, slow_deviation=1, wait_deviation=1, slow=1
    )
)
NO_OVERLOAD = GuardConfig(overload=1e6)
"""Settings of a controller whose authority stays NORMAL for 10 s without a frame and under any force: to
measure what the authority costs and saves in simulation; not for a device."""

Policy = Callable[[Float32[np.ndarray, " inputs"]], float]
"""From the inputs to the correction as a share of the largest, −1…1."""


class _Frame(NamedTuple):
    """A frame that came.

    made      when, in periods from the start
    u         under which it was made [the channel's unit]
    reading   of the controlled sensor [its unit]
    noise     standard deviation of the controlled sensor by zones where nothing can press [its unit]
    outlier   it was not taken in
    """

    made: int
    u: float
    reading: float
    noise: float
    outlier: bool


class Learned(Adaptive):
    """The adaptive controller whose command a policy corrects.

    policy    from `INPUTS` to the correction as a share of the largest
    largest   correction, as a share of the channel's peak
    others    as for `Adaptive`
    """

    def __init__(
        self,
        config: ControllerConfig,
        policy: Policy,
        largest: float,
        adaptive: AdaptiveConfig | None = None,
        guard: GuardConfig | None = None,
    ) -> None:
        self._policy, self._largest_correction = policy, largest * abs(config.driven.peak)
        super().__init__(config, adaptive, guard)

    def reset(self) -> None:
        """Return to the initial state, at u = 0."""
        super().reset()
        self._now = 0
        self._past: deque[_Frame] = deque(maxlen=FRAMES)

    def observe(self, measurement: object, missed: int = 0) -> None:
        """Take in what was measured."""
        self._now += 1 + missed
        super().observe(measurement, missed)

    def inputs(self, target: float) -> Float32[np.ndarray, " inputs"]:
        """What the policy knows before the coming command; `target` of the controlled sensor [its unit]."""
        observer, u, ahead, period = self.observer, self._frames.u, self._behind, self.config.period
        peak, full = abs(self.config.driven.peak), self._largest
        x, p = observer.ahead(ahead)
        deviation, wanted = np.sqrt(np.diag(p)), observer.command(target, ahead)
        known = [
            target / full,
            u / peak,
            (wanted - u) / peak,
            *(x / (1, peak, peak)),
            *(deviation / (1, peak, peak)),
            p[0, 1] / (deviation[0] * deviation[1]),
            p[1, 2] / (deviation[1] * deviation[2]),
            observer.sensitivity(x, wanted) * peak / full,
            self.unseen,
            ahead * period,
            min(self._now * period, 1.0),
        ]
        frames = np.tile([0.0, _NEVER, 0.0, 0.0, 0.0, 0.0], (FRAMES, 1))
        if self._past:
            made, at, reading, noise, outlier = np.array(self._past)[::-1].T
            # Where nothing presses the path has no inverse.
            shift = np.where(reading >= RELEASED, observer.shifts_of(x, at, reading) - x[1], 0.0)
            age = np.minimum((self._now - made) * period, _NEVER)
            columns = (shift / peak, age, noise / full, reading / full, outlier, (at - u) / peak)
            frames[: len(self._past)] = np.column_stack(columns)
        return np.clip(np.append(known, frames), -WIDEST, WIDEST).astype(np.float32)

    def aim(self, target: float) -> tuple[float, float]:
        """The coming command without a correction [the channel's unit], and ∂F/∂u there, by the observer.

        target   of the controlled sensor [its unit]
        """
        wanted = self.observer.command(target, self._behind)
        return wanted, self.observer.sensitivity(self.observer.ahead(self._behind)[0], wanted)

    def _observe(self, found: Measurement) -> None:
        super()._observe(found)
        outputs, u = found.reading.forces[0].astype(float), self._frames.command_of(found)
        made = self._now - 1 - round(found.age / self.config.period)
        noise = float(np.sqrt(self.observer.scatter(u, outputs)))
        self._past.append(_Frame(made, u, self.config.sum(outputs), noise, self.problem is not None))

    def _aim(self, target: float, ahead: int) -> float:
        share = float(self._policy(self.inputs(target)))
        share = max(-1.0, min(1.0, share)) if math.isfinite(share) else 0.0
        return super()._aim(target, ahead) + share * self._largest_correction
