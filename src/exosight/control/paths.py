"""What a controller knows of its exosuit: the force paths up and down, and the limits it keeps."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from exosight.errors import InputError


@dataclass(frozen=True, eq=False)
class ForcePath:
    """Contact forces along a path of loads, each pose the start of the next.

    u        (points,)     strictly rising or strictly falling [N]
    forces   (points, 7)   on C1…C7 [N]
    snapped  (points,)     the pose jumped on the way from the point before

    Raises InputError for fewer than two points, other shapes, a number that is not finite, or another order.
    """

    u: Float[np.ndarray, " points"]
    forces: Float[np.ndarray, "points 7"]
    snapped: Bool[np.ndarray, " points"]

    def __post_init__(self) -> None:
        steps = np.diff(self.u)
        if len(self.u) < 2 or not self.forces.shape == (len(self.u), 7) or self.snapped.shape != self.u.shape:
            raise InputError("force path: expected two points or more, each with u, 7 forces and snapped")
        if not (np.isfinite(self.u).all() and np.isfinite(self.forces).all()):
            raise InputError("force path: expected finite newtons, got a number that is not")
        if not (np.all(steps > 0) or np.all(steps < 0)):
            raise InputError("force path, u: expected loads that strictly rise or strictly fall")

    @property
    def net(self) -> Float[np.ndarray, " points"]:
        """F_net [N]."""
        return self.forces.sum(axis=1)

    @property
    def slopes(self) -> Float[np.ndarray, "steps 7"]:
        """∂F/∂u of each contact between two points [N/N]; 0 across a jump, which has none."""
        slope = np.diff(self.forces, axis=0) / np.diff(self.u)[:, None]
        return np.where(self.snapped[1:, None], 0.0, slope)

    @property
    def jumps(self) -> list[tuple[float, float]]:
        """F_net before and after each jump [N]."""
        net = self.net
        return [(float(net[i - 1]), float(net[i])) for i in np.flatnonzero(self.snapped)]

    def skips(self, force: float) -> bool:
        """Whether a F_net [N] lies within a jump."""
        return any(min(jump) < force < max(jump) for jump in self.jumps)

    def inverse(self) -> tuple[np.ndarray, np.ndarray]:
        """F_net, rising, and the u that shows it [N], for `numpy.interp`.

        A force within a jump is given the load just beyond the jump; where F_net dips, its running extreme
        counts.
        """
        up = self.u[-1] > self.u[0]
        net = (np.maximum if up else np.minimum).accumulate(self.net)
        force, load = [float(net[0])], [float(self.u[0])]
        for i in range(1, len(net)):
            if self.snapped[i]:
                force.append(float(net[i - 1]) + math.copysign(1e-9, 1 if up else -1))
                load.append(float(self.u[i]))
            force.append(float(net[i]))
            load.append(float(self.u[i]))
        order = slice(None) if up else slice(None, None, -1)
        return np.array(force[order]), np.array(load[order])


@dataclass(frozen=True, eq=False)
class ControllerConfig:
    """All that `Scheduled` knows of an exosuit; `exosight.control.tuning.tune` makes one.

    loading        from u = 0 up to the largest actuation
    unloading      from there down to the smallest
    contact_limit  (7,)  largest force on each of C1…C7 [N]
    rate           largest change of u a second [N/s]
    period         of a step of the loop [s]
    smallest_gain  bounds of Δu/ΔF_net [N/N]: without the lower one a jump that comes later than on the path
    largest_gain   would never be passed, without the upper one a flat path would ask for any u

    Raises InputError for paths that do not meet, or numbers that are not finite and above 0.
    """

    loading: ForcePath
    unloading: ForcePath
    contact_limit: Float[np.ndarray, "7"]
    rate: float
    period: float
    smallest_gain: float
    largest_gain: float

    def __post_init__(self) -> None:
        if not (self.loading.u[0] == 0 and self.loading.u[-1] == self.unloading.u[0] > self.unloading.u[-1]):
            raise InputError("controller: expected a path from u = 0 up, and one from its end down")
        if self.unloading.u[-1] > 0:
            raise InputError("controller: expected an unloading path down to u = 0 at least")
        numbers = (self.rate, self.period, self.smallest_gain, *self.contact_limit.tolist())
        if not (all(0 < number < math.inf for number in numbers)):
            raise InputError(
                "controller: expected limits, rate, period and gains that are finite and above 0"
            )
        if not self.smallest_gain <= self.largest_gain < math.inf:
            raise InputError("controller: expected finite gains, the smallest first")

    @property
    def u_max(self) -> float:
        """Largest actuation [N]."""
        return float(self.loading.u[-1])

    @property
    def u_min(self) -> float:
        """Smallest actuation [N], 0 or below."""
        return float(self.unloading.u[-1])

    @property
    def step(self) -> float:
        """Largest change of u in one step [N]."""
        return self.rate * self.period

    def reachable(self, target: float) -> float:
        """The target [N], or the largest force below it that the exosuit can rest at.

        What lies in a jump both up and down is never at rest; then 98 % of the force before the jump up.
        """
        if self.unloading.skips(target):
            for low, high in self.loading.jumps:
                if low < target < high:
                    return 0.98 * low
        return min(target, float(self.loading.net[-1]))


def limited(config: ControllerConfig, u: float, wanted: float) -> float:
    """The actuation nearest to the wanted one that amplitude and rate allow from u [N]; u if it is NaN."""
    if math.isnan(wanted):
        return u
    wanted = max(u - config.step, min(u + config.step, wanted))
    return float(max(config.u_min, min(config.u_max, wanted)))
