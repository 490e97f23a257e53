"""What a plant does that is not the one that was solved: an extended Kalman filter on its force path.

The solved path F₀(u) of the nominal plant is scaled and shifted,

    F(u) = s F₀(w),   w = (u − d) / s,

with s the stiffness of the whole (exact where all stiffnesses and u grow alike: the pose stays, forces scale)
and d a shift of the command: joints that rest elsewhere, a gap, a mount, a modulus of the exosuit alone. The
state is (log s, d, ḋ); ḋ decays, as a user's motion does (Singer, IEEE Trans. Aerosp. Electron. Syst. 6,
1970), so that a delayed frame is extrapolated to the present. F₀ is a table: nothing is solved in the loop.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as configuration

from exosight.control.paths import ControllerConfig
from exosight.control.scheduled import RELEASED

_ITERATIONS = 3
_LONGEST = 200  # steps; what is older says nothing of the present
_FARTHEST = 0.7  # of log s: half or twice as stiff
_MEDIAN = 0.455  # of the square of a normal variable, as a share of its variance
Share = Annotated[float, Field(gt=0, le=1)]
Positive = Annotated[float, Field(gt=0)]


@configuration(frozen=True, config=ConfigDict(extra="forbid"))
class ObserverConfig:
    """What is known of plants and users before anything is measured; shares of the channel's peak."""

    stiffness: Share = 0.1
    """standard deviation of log s"""
    shift: Share = 0.06
    """standard deviation of d"""
    speed: Share = 0.05
    """standard deviation of ḋ in motion [1/s]"""
    motion_time: Positive = 0.7
    """time after which a user's motion is another one [s]"""
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
        self.reset()

    def reset(self) -> None:
        """Forget the plant."""
        given, peak = self._given, self._peak
        self._x = np.zeros(3)
        self._p = np.diag(np.square([given.stiffness, given.shift * peak, given.speed * peak]))
        self._outliers: deque[float] = deque(maxlen=given.agreeing)

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
        x, p = self.ahead(ahead)
        force, gradient = self._model(x, u)
        deviation = math.sqrt(max(float(gradient @ p @ gradient), 0.0))
        w = (u - x[1]) / math.exp(x[0])
        outputs = np.array([np.interp(w, self._u, each) for each in self._outputs.T])
        return Prediction(force, deviation, math.exp(x[0]) * outputs)

    def command(self, target: float, ahead: int = 0) -> float:
        """u at which the controlled sensor reads the target so many steps after the last frame."""
        return self.command_of(self.ahead(ahead)[0], target)

    def command_of(self, x: Float[np.ndarray, "3"], target: float) -> float:
        """The same in a state (log s, d, ḋ) that `ahead` gives."""
        s = math.exp(x[0])
        wanted = target / s
        w = float(np.interp(wanted, self._force, self._u))
        if wanted > self._force[-1]:
            w = float(self._u[-1] + (wanted - self._force[-1]) / self._slope(self._u[-1]))
        return float(x[1] + s * w)

    def largest(self, ahead: int = 0) -> float:
        """The largest u at which every estimated sensor is within its limit, on the path as it is now."""
        x, _ = self.ahead(ahead)
        s = math.exp(x[0])
        over = (s * self._outputs > self._config.output_limits).any(axis=1)
        w = self._u[max(int(np.argmax(over)) - 1, 0)] if over.any() else math.inf
        return float(x[1] + s * w)

    def advance(self, steps: int) -> None:
        """Move the state on to a later frame."""
        self._x, self._p = self.ahead(steps)

    def update(self, u: float, outputs: Float[np.ndarray, " outputs"], deviation: float) -> bool:
        """Take in what was measured under u at the time of the state; returns False for an outlier.

        outputs    (outputs,) of the estimated sensors [each in its unit]
        deviation  standard deviation of the controlled sensor as the estimator gives it [its unit]
        """
        given, measured = self._given, self._config.sum(outputs)
        force, _ = self._model(self._x, u)
        if max(force, measured) < RELEASED:
            self._outliers.clear()
            return True  # nothing presses, and nothing is learned from that
        noise = deviation**2 + (given.noise * self._largest) ** 2 + self.scatter(u, outputs)
        _, gradient = self._model(self._x, u, touching=True)
        innovation = measured - force
        spread = math.sqrt(float(gradient @ self._p @ gradient) + noise)
        if abs(innovation) > given.gate * spread:
            self._outliers.append(measured)
            agree = len(self._outliers) == given.agreeing and np.ptp(self._outliers) < given.gate * spread
            if not agree:
                return False
            # The plant is another than it was: as unknown as at first.
            self._p += np.diag(np.square([0.0, given.shift * self._peak, given.speed * self._peak]))
        self._outliers.clear()
        x = self._x
        for _ in range(_ITERATIONS):  # as the path bends
            force, gradient = self._model(x, u, touching=True)
            gain = self._p @ gradient / (gradient @ self._p @ gradient + noise)
            x = self._x + gain * (measured - force - gradient @ (self._x - x))
            x = np.clip(x, *self._range)
        _, gradient = self._model(x, u, touching=True)
        gain = self._p @ gradient / (gradient @ self._p @ gradient + noise)
        keep = np.eye(3) - np.outer(gain, gradient)
        self._x, self._p = x, keep @ self._p @ keep.T + noise * np.outer(gain, gain)
        return True

    def scatter(self, u: float, outputs: Float[np.ndarray, " outputs"]) -> float:
        """Variance of the controlled sensor by what is measured under u where nothing can press.

        By the median, as noise is on every output, and a contact that the model has elsewhere on few: taken
        for noise it would keep a wrong state as it is.
        """
        w = (u - self._x[1]) / math.exp(self._x[0])
        near = np.abs(self._u - w) <= 0.12 * self._peak
        free = (self._outputs[near] <= 0).all(axis=0) & (self._config.weights != 0)
        if not near.any() or not free.any():
            return 0.0
        middle = float(np.quantile(np.square(outputs[free]), 0.5, method="lower"))
        return float(np.count_nonzero(self._config.weights) * middle / _MEDIAN)

    def ahead(self, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """(log s, d, ḋ) so many steps after the last frame, and their covariance (3, 3)."""
        given, period = self._given, self._config.period
        keep = math.exp(-period / given.motion_time)
        move = np.array([[1, 0, 0], [0, 1, period], [0, 0, keep]])
        wander = given.wander * self._peak
        stir = np.diag([1e-6, wander**2, (given.speed * self._peak) ** 2 * (1 - keep**2)])
        x, p = self._x, self._p
        for _ in range(min(steps, _LONGEST)):
            x, p = move @ x, move @ p @ move.T + stir
        return x, p

    def sensitivity(self, x: Float[np.ndarray, "3"], u: float) -> float:
        """∂F/∂u under u in a state (log s, d, ḋ) that `ahead` gives."""
        return self._slope((u - x[1]) / math.exp(x[0]))

    def shifts_of(
        self,
        x: Float[np.ndarray, "3"],
        u: Float[np.ndarray, " frames"],
        reading: Float[np.ndarray, " frames"],
    ) -> Float[np.ndarray, " frames"]:
        """d by single readings of the controlled sensor under u, with s of a state that `ahead` gives."""
        s = math.exp(x[0])
        return u - s * np.interp(reading / s, self._force, self._u)

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
