"""What a plant does that is not the one that was solved: an extended Kalman filter on its force path.

The solved path F₀(u) of the nominal plant is scaled and shifted,

    F(u) = s F₀(w),   w = (u − d) / s,

with s the stiffness of the whole (exact where all stiffnesses and u grow alike: the pose stays, forces scale)
and d a shift of the command: joints that rest elsewhere, a gap, a mount, a modulus of the exosuit alone. The
state is (log s, d, ḋ). A user rests, and ḋ = 0, or moves, and ḋ decays, as his motion does (Singer, IEEE
Trans. Aerosp. Electron. Syst. 6, 1970), so that a delayed frame is extrapolated to the present; which it is
follows from the frames (`user_modes`). F₀ is a table: nothing is solved in the loop.
"""

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as configuration

from exosight.control.paths import ControllerConfig
from exosight.control.scheduled import RELEASED
from exosight.control.user_modes import Motion, UserModes

_ITERATIONS = 3
_LONGEST = 200  # steps; what is older says nothing of the present
_NEAR = 0.12  # of the peak: so far off, an output without force on the path is one that cannot press
_ELSEWHERE = 0.01  # of the largest reading: what another plant presses with where the path has nothing
_FARTHEST = 0.7  # of log s: half or twice as stiff
_STILL = np.diag([1.0, 1.0, 0.0])
_AGES = 1e-6  # variance of the change of log s in a step
Share = Annotated[float, Field(gt=0, le=1)]
Positive = Annotated[float, Field(gt=0)]


@configuration(frozen=True, config=ConfigDict(extra="forbid"))
class ObserverConfig:
    """What is known of plants and users before anything is measured; shares of the channel's peak."""

    stiffness: Share = 0.1
    """standard deviation of log s"""
    shift: Share = 0.06
    """standard deviation of d"""
    speed: Share = 0.1
    """standard deviation of ḋ in motion [1/s]"""
    motion_time: Positive = 0.3
    """time after which a user's motion is another one [s]"""
    mode_time: Positive = 1.0
    """time after which a user who rests moves, and one who moves rests [s]"""
    rest: Share = 0.1
    """share of `wander` while the user rests"""
    wander: Share = 0.002
    """standard deviation of the change of d in a step that ḋ does not explain"""
    noise: Share = 0.005
    """standard deviation of a perfect estimate, as a share of the largest reading of the path"""
    gate: Positive = 3.5
    """standard deviations beyond which a measurement is an outlier"""
    agreeing: Annotated[int, Field(ge=2, le=100)] = 3
    """outliers in a row that agree with each other, and are believed"""


@dataclass(frozen=True)
class Prediction:
    """The plant under a command.

    controlled  sensor [its unit]
    deviation   its standard deviation [its unit]
    outputs     (outputs,) of the estimated sensors [each in its unit]
    """

    controlled: float
    deviation: float
    outputs: Float[np.ndarray, " outputs"]


class Observer:
    """The filter; its state is that of the last frame, and `ahead` of it is predicted.

    config   limits and solved paths
    given    what is known before
    """

    def __init__(self, config: ControllerConfig, given: ObserverConfig | None = None) -> None:
        self._config, self._given = config, given or ObserverConfig()
        path, self._peak = config.loading, abs(config.driven.peak)
        self._u = path.u
        self._force = np.maximum.accumulate(path.controlled)
        self._outputs = path.outputs
        self._least = 1 / config.largest_gain  # of the slope, also where nothing presses yet
        self._largest = float(self._force.max())
        most = np.array([_FARTHEST, self._peak, self._peak])
        self._range = -most, most
        self._motion = _motion(self._given, self._peak, config.period)
        self.reset()

    def reset(self) -> None:
        """Forget the plant."""
        given, peak = self._given, self._peak
        p = np.diag(np.square([given.stiffness, given.shift * peak, given.speed * peak]))
        self._now = UserModes(np.array([0.5, 0.5]), np.zeros((2, 3)), np.stack([_STILL @ p @ _STILL, p]))
        self._outliers: deque[float] = deque(maxlen=given.agreeing)

    @property
    def _x(self) -> np.ndarray:
        return self._now.mean

    @property
    def _p(self) -> np.ndarray:
        return self._now.covariance

    @property
    def moving(self) -> float:
        """Probability that the user moved at the last frame [-]."""
        return float(self._now.share[1])

    @property
    def state(self) -> Float[np.ndarray, "3"]:
        """(s [-], d [the channel's unit], ḋ [its unit a second]) at the last frame."""
        return np.array([math.exp(self._x[0]), self._x[1], self._x[2]])

    @property
    def covariance(self) -> Float[np.ndarray, "3 3"]:
        """Of (log s, d, ḋ) at the last frame."""
        return self._p.copy()

    def predict(self, u: float, ahead: int = 0) -> Prediction:
        """The plant under u, so many steps after the last frame."""
        x, p = self._ahead(ahead)
        force, gradient = self._model(x, u)
        deviation = math.sqrt(max(float(gradient @ p @ gradient), 0.0))
        w = (u - x[1]) / math.exp(x[0])
        outputs = np.array([np.interp(w, self._u, each) for each in self._outputs.T])
        return Prediction(force, deviation, math.exp(x[0]) * outputs)

    def command(self, target: float, ahead: int = 0) -> float:
        """u at which the controlled sensor reads the target so many steps after the last frame."""
        x, _ = self._ahead(ahead)
        s = math.exp(x[0])
        wanted = target / s
        w = float(np.interp(wanted, self._force, self._u))
        if wanted > self._force[-1]:
            w = float(self._u[-1] + (wanted - self._force[-1]) / self._slope(self._u[-1]))
        return float(x[1] + s * w)

    def largest(self, ahead: int = 0) -> float:
        """The largest u at which every estimated sensor is within its limit, on the path as it is now."""
        x, _ = self._ahead(ahead)
        s = math.exp(x[0])
        over = (s * self._outputs > self._config.output_limits).any(axis=1)
        w = self._u[max(int(np.argmax(over)) - 1, 0)] if over.any() else math.inf
        return float(x[1] + s * w)

    def advance(self, steps: int) -> None:
        """Move the state on to a later frame."""
        self._now = self._later(steps)

    def update(self, u: float, outputs: Float[np.ndarray, " outputs"], deviation: float) -> bool:
        """Take in what was measured under u at the time of the state; returns False for an outlier.

        outputs    (outputs,) of the estimated sensors [each in its unit]
        deviation  standard deviation of the controlled sensor as the estimator gives it [its unit]
        """
        given = self._given
        measured, scatter = self._pressing(u, outputs)
        force, _ = self._model(self._x, u)
        if max(force, measured) < RELEASED:
            self._outliers.clear()
            return True  # nothing presses, and nothing is learned from that
        noise = deviation**2 + (given.noise * self._largest) ** 2 + scatter
        _, gradient = self._model(self._x, u, touching=True)
        innovation = measured - force
        spread = math.sqrt(float(gradient @ self._p @ gradient) + noise)
        if abs(innovation) > given.gate * spread:
            self._outliers.append(measured)
            agree = len(self._outliers) == given.agreeing and np.ptp(self._outliers) < given.gate * spread
            if not agree:
                return False
            # The plant is another than it was: as unknown as at first.
            new = np.diag(np.square([0.0, given.shift * self._peak, given.speed * self._peak]))
            self._now = replace(self._now, p=self._now.p + new)
        self._outliers.clear()
        modes = zip(self._now.x, self._now.p, strict=True)
        x, p, likely = zip(*(self._corrected(*mode, u, measured, noise) for mode in modes), strict=True)
        self._now = UserModes(self._now.share, np.stack(x), np.stack(p)).weighted(np.array(likely))
        return True

    def _corrected(
        self, x: np.ndarray, p: np.ndarray, u: float, measured: float, noise: float
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """State and covariance with a measurement, and the logarithm of its likelihood."""
        prior = x
        force, gradient = self._model(prior, u, touching=True)
        variance = float(gradient @ p @ gradient) + noise
        likely = -0.5 * (math.log(variance) + (measured - force) ** 2 / variance)
        for _ in range(_ITERATIONS):  # as the path bends
            force, gradient = self._model(x, u, touching=True)
            gain = p @ gradient / (gradient @ p @ gradient + noise)
            x = prior + gain * (measured - force - gradient @ (prior - x))
            x = np.clip(x, *self._range)
        _, gradient = self._model(x, u, touching=True)
        gain = p @ gradient / (gradient @ p @ gradient + noise)
        keep = np.eye(3) - np.outer(gain, gradient)
        return x, keep @ p @ keep.T + noise * np.outer(gain, gain), likely

    def _pressing(self, u: float, outputs: Float[np.ndarray, " outputs"]) -> tuple[float, float]:
        """The controlled sensor, and its variance by the noise of what is measured where nothing can press.

        There outputs count by the share of their variance that is another plant's force and not noise.
        """
        weights = self._config.weights
        w = (u - self._x[1]) / math.exp(self._x[0])
        near = np.abs(self._u - w) <= _NEAR * self._peak
        free = (self._outputs[near] <= 0).all(axis=0) & (weights != 0)
        if not near.any() or not free.any():
            return self._config.sum(outputs), 0.0
        noise = float(np.mean(np.square(outputs[free])))
        own = (_ELSEWHERE * self._largest) ** 2
        share = np.where(free, own / (own + noise), 1.0)
        return self._config.sum(share * outputs), float(share @ weights**2) * noise

    def _ahead(self, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """State and covariance so many steps later."""
        later = self._later(steps)
        return later.mean, later.covariance

    def _later(self, steps: int) -> UserModes:
        return self._now.later(min(steps, _LONGEST), self._motion)

    def _slope(self, w: float) -> float:
        """∂F₀/∂w, over a fortieth of the peak to both sides."""
        half = self._peak / 40
        low, high = np.interp([w - half, w + half], self._u, self._force)
        return max(float(high - low) / (min(w + half, self._u[-1]) - min(w - half, self._u[-1]) + 1e-12), 0.0)

    def _model(self, x: np.ndarray, u: float, touching: bool = False) -> tuple[float, np.ndarray]:
        """The controlled sensor, and its gradient in the state; `touching`: never of a slope of 0."""
        s = math.exp(x[0])
        w = (u - x[1]) / s
        end = float(self._u[-1])
        slope = self._slope(min(w, end))
        force = float(np.interp(w, self._u, self._force)) + max(w - end, 0.0) * slope
        if touching:
            slope = max(slope, self._least)
        return s * force, np.array([s * force - w * s * slope, -slope, 0.0])


def _motion(given: ObserverConfig, peak: float, period: float) -> Motion:
    """What a step of the loop does to the states of a user at rest and of one who moves."""
    change = 1 - math.exp(-period / given.mode_time)
    keep = math.exp(-period / given.motion_time)
    moves = np.array([[1, 0, 0], [0, 1, period], [0, 0, keep]])
    wander, speed = given.wander * peak, given.speed * peak
    rest = np.diag([_AGES, (given.rest * wander) ** 2, 0.0])
    motion = np.diag([_AGES, wander**2, speed**2 * (1 - keep**2)])
    turn = np.array([[1 - change, change], [change, 1 - change]])
    return Motion(turn, np.stack([_STILL, moves]), np.stack([rest, motion]))
