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
_NEAR = 0.12  # of the peak: so far off, an output without force on the path is one that cannot press
_ELSEWHERE = 0.01  # of the largest reading: what another plant presses with where the path has nothing
_FARTHEST = 0.7  # of log s: half or twice as stiff
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


@dataclass(frozen=True)
class Modes:
    """What is known if the user rests, and if he moves.

    share  (2,)        probability of each [-]
    x      (2, 3)      states
    p      (2, 3, 3)   their covariances
    """

    share: Float[np.ndarray, "2"]
    x: Float[np.ndarray, "2 3"]
    p: Float[np.ndarray, "2 3 3"]

    @property
    def mean(self) -> Float[np.ndarray, "3"]:
        """The state, whichever it is."""
        return self.share @ self.x

    @property
    def covariance(self) -> Float[np.ndarray, "3 3"]:
        """Of that state."""
        return self._about(self.share, self.mean)

    def _about(self, share: np.ndarray, mean: np.ndarray) -> np.ndarray:
        off = self.x - mean
        return np.einsum("m,mij->ij", share, self.p + off[:, :, None] * off[:, None, :])

    def mixed(self, turn: Float[np.ndarray, "2 2"]) -> "Modes":
        """The same where modes may have changed, with these probabilities from row to column."""
        joint = self.share[:, None] * turn
        share = joint.sum(axis=0)
        of = (joint / share).T
        x = of @ self.x
        return Modes(share, x, np.stack([self._about(part, mean) for part, mean in zip(of, x, strict=True)]))


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
        p = np.diag(np.square([given.stiffness, given.shift * peak, given.speed * peak]))
        still = np.diag([1.0, 1.0, 0.0])
        self._now = Modes(np.array([0.5, 0.5]), np.zeros((2, 3)), np.stack([still @ p @ still, p]))
        self._outliers: deque[float] = deque(maxlen=given.agreeing)

    @property
    def _x(self) -> np.ndarray:
        return self._now.mean

    @property
    def _p(self) -> np.ndarray:
        return self._now.covariance

    @property
    def moving(self) -> float:
        """Probability that the user moves, at the last frame [-]."""
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
            self._now = Modes(self._now.share, self._now.x, self._now.p + new)
        self._outliers.clear()
        x, p, likely = self._now.x.copy(), self._now.p.copy(), np.zeros(len(self._now.x))
        for i in range(len(x)):
            x[i], p[i], likely[i] = self._corrected(self._now.x[i], self._now.p[i], u, measured, noise)
        share = self._now.share * np.exp(likely - likely.max())
        self._now = Modes(share / share.sum(), x, p)
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
        weights, config = self._config.weights, self._config
        w = (u - self._x[1]) / math.exp(self._x[0])
        near = np.abs(self._u - w) <= _NEAR * self._peak
        free = (self._outputs[near] <= 0).all(axis=0) & (weights != 0)
        if not near.any() or not free.any():
            return config.sum(outputs), 0.0
        noise = float(np.mean(np.square(outputs[free])))
        own = (_ELSEWHERE * self._largest) ** 2
        share = np.where(free, own / (own + noise), 1.0)
        return float(share * weights @ outputs), float(share * weights**2 @ np.ones(len(weights))) * noise

    def _ahead(self, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """State and covariance so many steps later."""
        later = self._later(steps)
        return later.mean, later.covariance

    def _later(self, steps: int) -> Modes:
        """The modes so many steps later."""
        given, period = self._given, self._config.period
        keep, change = math.exp(-period / given.motion_time), 1 - math.exp(-period / given.mode_time)
        turn = np.array([[1 - change, change], [change, 1 - change]])
        still = np.diag([1.0, 1.0, 0.0])
        move = np.stack([still, [[1, 0, 0], [0, 1, period], [0, 0, keep]]])
        wander, speed = given.wander * self._peak, given.speed * self._peak
        stir = np.stack(
            [
                np.diag([1e-6, (given.rest * wander) ** 2, 0.0]),
                np.diag([1e-6, wander**2, speed**2 * (1 - keep**2)]),
            ]
        )
        now = self._now
        for _ in range(min(steps, _LONGEST)):
            mixed = now.mixed(turn)
            now = Modes(
                mixed.share,
                np.einsum("mij,mj->mi", move, mixed.x),
                move @ mixed.p @ move.transpose(0, 2, 1) + stir,
            )
        return now

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
