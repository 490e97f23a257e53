"""A law that knows its plant: the next actuation from force paths that were solved beforehand."""

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float

from exosight.control.responses import TOLERANCE
from exosight.errors import InputError

RELEASED = 0.005
"""Below this F_net [N] nothing presses, and a target below it asks for release."""

_MARGIN = 0.05  # [N]: how near to a jump of the path a force in the band rests
_HALVINGS = 4  # the least share of a step is 1/16: slow, yet not asleep if the user moves
_PATIENCE = 10  # steps on one side of the target until the share doubles again


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


@dataclass
class Scheduled:
    """Integral law whose gain is the plant's own, read off the solved paths U↑(F) and U↓(F).

        u_k = u + γ (U(F_t) − U(F_net)),    U = U↑ where force is missing, U↓ where there is too much,

    with u the actuation under which F_net was measured, so that a delayed picture asks for no step twice.

    gain    Δu/ΔF_net is kept below the largest gain. Where U(F) asks for less than the smallest, the jump
            that the path promises has not come: u goes on by 0.05 N, then 0.10 N and so on, up to that gain.
    γ       1 outside the band of ±5 %, ½ inside. It halves each time the error changes sides outside the
            band, but for the first time (a jump may have to be passed and undone), down to 1/16, and doubles
            after 10 steps on one side.
    fences  In the band u stays 0.05 N away from the jumps of the path. A force that jumped over a target
            which the path can rest at shows where the jump is: the next time u goes half-way there.

    u is clipped in amplitude and rate after that, and the clipped value is what is remembered: nothing winds
    up.

    A contact above its limit unloads, whatever the target. A target below 5 mN releases: u → 0 at the full
    rate, and if the pose at u ≤ 0 still presses, on to u_min until it lets go, then back to 0.

    A measurement that is no finite number leaves u as it is.
    """

    config: ControllerConfig
    _u: float = field(init=False, repr=False, default=0.0)
    _target: float = field(init=False, repr=False, default=0.0)
    _side: int = field(init=False, repr=False, default=0)
    _reversals: int = field(init=False, repr=False, default=0)
    _streak: int = field(init=False, repr=False, default=0)
    _stalls: int = field(init=False, repr=False, default=0)
    _last: tuple[float, float] | None = field(init=False, repr=False, default=None)
    _jumped: dict[int, float] = field(init=False, repr=False, default_factory=dict)
    """by the direction of the step: the u [N] after which the force jumped over this target"""

    def __post_init__(self) -> None:
        self._up = self.config.loading.inverse()
        self._down = self.config.unloading.inverse()

    @property
    def u(self) -> float:
        """The present actuation [N]."""
        return self._u

    def reset(self) -> None:
        """Return to u_0 = 0 and forget."""
        self._u = 0.0
        self._aim(0.0)

    def track(self, u: float) -> None:
        """Take note that the plant was given another u [N] than this law asked for."""
        self._u = u

    def next(
        self,
        target: float | Float[np.ndarray, "7"],
        measured: float,
        contacts: Float[np.ndarray, "7"] | None = None,
        at: float | None = None,
    ) -> float:
        """The actuation u_k [N].

        target    F_t [N], or (7,) a force for each of C1…C7 [N]: then the step is the least-squares one,
                  Δu = s·(F_t − F)/(s·s) with s = ∂F/∂u of the contacts on the path
        measured  F_net [N]
        contacts  (7,) forces on C1…C7 [N]; without them no contact's limit is kept, and `target` is a number
        at        actuation under which they were measured [N]; the present one by default

        Raises InputError if the target is no finite number, or one for each contact without `contacts`.
        """
        if not np.isfinite(target).all():
            raise InputError(f"target force: expected finite newtons, got {target}")
        if isinstance(target, np.ndarray) and contacts is None:
            raise InputError("target force: one for each contact needs measured contacts, got none")
        if not math.isfinite(measured) or (contacts is not None and not np.isfinite(contacts).all()):
            return self._u
        at = self._u if at is None else at
        net = float(np.sum(target))
        if net < RELEASED:
            wanted = self._release(measured, at)
        elif isinstance(target, np.ndarray) and contacts is not None:
            wanted = at + self._share(net, measured, at) * self._fit(target, contacts, at)
        else:
            goal = self.config.reachable(net)
            wanted = self._towards(goal, measured, at, self._share(goal, measured, at))
        if contacts is not None:
            excess = float((contacts - self.config.contact_limit).max())
            if excess > 0:
                wanted = min(wanted, at - self.config.largest_gain * excess)
        self._u = limited(self.config, self._u, wanted)
        return self._u

    def _towards(self, goal: float, measured: float, at: float, share: float) -> float:
        error = goal - measured
        direction = 1 if error > 0 else -1
        force, load = self._up if error > 0 else self._down
        begin, end = np.interp([max(measured, 0.0), goal], force, load)
        if error > 0 and measured < RELEASED:
            at = max(at, min(begin, self.config.u_max))  # nothing presses yet: go to where contact begins
        size, least = abs(end - begin), self.config.smallest_gain * abs(error)
        self._stalls = self._stalls + 1 if size < least else 0
        size = min(max(size, min(least, _MARGIN * self._stalls)), self.config.largest_gain * abs(error))
        wanted = at + share * direction * size
        for fence in self._fences(goal, error, at, direction):
            # What lies behind already is passed; but just behind, in the margin of a jump to come, u rests.
            if direction * (fence - at) > -_MARGIN:
                stop = fence if direction * (fence - at) > 0 else at
                wanted = min(wanted, stop) if direction > 0 else max(wanted, stop)
        return wanted

    def _fences(self, goal: float, error: float, at: float, direction: int) -> list[float]:
        """Loads [N] that a step in this direction must not pass."""
        path = self.config.loading if direction > 0 else self.config.unloading
        fences = []
        if abs(error) <= TOLERANCE * goal:
            fences = [float(path.u[i - 1]) - direction * _MARGIN for i in np.flatnonzero(path.snapped)]
        if direction in self._jumped and not path.skips(goal):
            fences.append(self._jumped[direction])
        return fences

    def _release(self, measured: float, at: float) -> float:
        if measured < RELEASED:  # slowly back from below, lest it closes again
            return min(self._u + 0.1 * self.config.step, 0.0) if self._u < 0 else 0.0
        return 0.0 if at > 0 else self.config.u_min

    def _fit(self, target: Float[np.ndarray, "7"], contacts: Float[np.ndarray, "7"], at: float) -> float:
        """The least-squares step [N]; where nothing presses, that of the sum."""
        missing = target - contacts
        path = self.config.loading if missing.sum() > 0 else self.config.unloading
        middle = 0.5 * (path.u[1:] + path.u[:-1])
        slope = path.slopes[int(np.abs(middle - at).argmin())]
        if not slope @ slope > 0:
            net = float(target.sum())
            return self._towards(net, float(contacts.sum()), at, 1.0) - at
        most = self.config.largest_gain * float(np.abs(missing).sum())
        return float(np.clip(slope @ missing / (slope @ slope), -most, most))

    def _aim(self, goal: float) -> None:
        """Forget what was learned about another target."""
        self._target, self._side, self._reversals, self._streak, self._stalls = goal, 0, 0, 0, 0
        self._last, self._jumped = None, {}

    def _share(self, goal: float, measured: float, at: float) -> float:
        """γ, and what the last step tells of jumps."""
        band = TOLERANCE * goal
        if abs(goal - self._target) > band:
            self._aim(goal)
        error = goal - measured
        if self._last is not None:
            u, force = self._last
            direction = 1 if at > u else -1
            jump = direction * (measured - force)
            if (goal - force) * error < 0 and jump > 0.5 * abs(at - u) / self.config.smallest_gain + 2 * band:
                # Half-way, unless the jump is known well enough.
                self._jumped[direction] = 0.5 * (u + at) if abs(at - u) > 2 * _MARGIN else u
        self._last = at, measured
        if abs(error) <= band:
            return 0.5 ** max(self._reversals, 1)
        side = 1 if error > 0 else -1
        self._streak = self._streak + 1 if side == self._side else 0
        if self._side and side != self._side:
            self._reversals = min(self._reversals + 1, _HALVINGS + 1)
        elif self._streak >= _PATIENCE:
            self._reversals, self._streak = max(self._reversals - 1, 0), 0
        self._side = side
        return 0.5 ** max(self._reversals - 1, 0)


def limited(config: ControllerConfig, u: float, wanted: float) -> float:
    """The actuation nearest to the wanted one that amplitude and rate allow from u [N]; u if it is NaN."""
    if math.isnan(wanted):
        return u
    wanted = max(u - config.step, min(u + config.step, wanted))
    return max(config.u_min, min(config.u_max, wanted))
