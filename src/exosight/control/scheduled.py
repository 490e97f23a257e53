"""A gain-scheduled law: the next command from paths that were solved beforehand."""

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from exosight.control.paths import ControllerConfig, limited
from exosight.control.responses import TOLERANCE
from exosight.errors import InputError

RELEASED = 0.005
"""Below this reading [N or rad] nothing presses, and a target below it asks for release."""

_HALVINGS = 4  # the least share of a step is 1/16: slow, but still able to follow a user who moves
_PATIENCE = 10  # steps on one side of the target until the share doubles again


@dataclass
class Scheduled:
    """Integral law whose gain is the plant's own, read off the solved paths U↑(F) and U↓(F).

        u_k = u + γ (U(F_t) − U(F)),    U = U↑ where force is missing, U↓ where there is too much,

    with F the controlled sensor and u the command under which it was measured, so that a delayed picture asks
    for no step twice.

    gain    Δu/ΔF is kept below the largest gain. Where U(F) asks for less than the smallest, the jump
            that the path promises has not come: u goes on by 1/80 of the
            channel's peak, then 2/80 and so on, up to that gain.
    γ       1 outside the band of ±5 %, ½ inside. It halves each time the error changes sides outside the
            band, but for the first time (a jump may have to be passed and undone), down to 1/16, and doubles
            after 10 steps on one side.
    fences  In the band u stays 1/80 of the channel's peak away from the jumps of the path. A force that
            jumped over a target which the path can rest at shows where the jump is: the next time u goes
            half-way there.

    u is clipped in amplitude and rate after that, and the clipped value is what is remembered: nothing winds
    up.

    An output above its limit unloads, whatever the target. A target below 0.005 releases: u → 0 at the full
    rate, and if the pose at u ≤ 0 still presses, on to u_min until it is released, then back to 0.

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
    """by the direction of the step: the u after which the force jumped over this target"""

    def __post_init__(self) -> None:
        self._up = self.config.loading.inverse()
        self._down = self.config.unloading.inverse()

    @property
    def u(self) -> float:
        """The present command [the channel's unit]."""
        return self._u

    def reset(self) -> None:
        """Return to u_0 = 0 and forget."""
        self._u = 0.0
        self._aim(0.0)

    def track(self, u: float) -> None:
        """Take note that the plant was given another u than this law asked for."""
        self._u = u

    def next(
        self,
        target: float | Float[np.ndarray, " outputs"],
        measured: float,
        outputs: Float[np.ndarray, " outputs"] | None = None,
        at: float | None = None,
    ) -> float:
        """The command u_k [the channel's unit].

        target    of the sensor [its unit], or (outputs,) one for each estimated sensor [its unit]: then the
                  step is the least-squares one, Δu = s·(F_t − F)/(s·s) with s = ∂F/∂u of the outputs on the
                  path
        measured  the controlled sensor [its unit]
        outputs   (outputs,) the estimated sensors; without them no limit of theirs is kept, and `target` is a
                  number
        at        command under which they were measured; the present one by default

        Raises InputError if the target is no finite number, or one for each output without `outputs`.
        """
        if not np.isfinite(target).all():
            raise InputError(f"target: expected finite numbers, got {target}")
        if isinstance(target, np.ndarray) and outputs is None:
            raise InputError("target: one for each output needs measured outputs, got none")
        if not math.isfinite(measured) or (outputs is not None and not np.isfinite(outputs).all()):
            return self._u
        at = self._u if at is None else at
        net = self.config.sum(target) if isinstance(target, np.ndarray) else float(target)
        if net < RELEASED:
            wanted = self._release(measured, at)
        elif isinstance(target, np.ndarray) and outputs is not None:
            wanted = at + self._share(net, measured, at) * self._fit(target, outputs, at)
        else:
            goal = self.config.reachable(net)
            wanted = self._towards(goal, measured, at, self._share(goal, measured, at))
        if outputs is not None:
            excess = float((outputs - self.config.output_limits).max())
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
        size = min(
            max(size, min(least, self.config.margin * self._stalls)), self.config.largest_gain * abs(error)
        )
        wanted = at + share * direction * size
        for fence in self._fences(goal, error, at, direction):
            # What lies behind already is passed; but just behind, in the margin of a jump to come, u rests.
            if direction * (fence - at) > -self.config.margin:
                stop = fence if direction * (fence - at) > 0 else at
                wanted = min(wanted, stop) if direction > 0 else max(wanted, stop)
        return wanted

    def _fences(self, goal: float, error: float, at: float, direction: int) -> list[float]:
        """Commands that a step in this direction must not pass."""
        path = self.config.loading if direction > 0 else self.config.unloading
        fences = []
        if abs(error) <= TOLERANCE * goal:
            fences = [
                float(path.u[i - 1]) - direction * self.config.margin for i in np.flatnonzero(path.snapped)
            ]
        if direction in self._jumped and not path.skips(goal):
            fences.append(self._jumped[direction])
        return fences

    def _release(self, measured: float, at: float) -> float:
        if measured < RELEASED:  # slowly back from below, lest it closes again
            return min(self._u + 0.1 * self.config.step, 0.0) if self._u < 0 else 0.0
        return 0.0 if at > 0 else self.config.u_min

    def _fit(
        self, target: Float[np.ndarray, " outputs"], outputs: Float[np.ndarray, " outputs"], at: float
    ) -> float:
        """The least-squares step; where nothing presses, that of the controlled sensor."""
        missing = target - outputs
        path = self.config.loading if self.config.sum(missing) > 0 else self.config.unloading
        middle = 0.5 * (path.u[1:] + path.u[:-1])
        slope = path.slopes[int(np.abs(middle - at).argmin())]
        if not slope @ slope > 0:
            return self._towards(self.config.sum(target), self.config.sum(outputs), at, 1.0) - at
        most = self.config.largest_gain * float(np.abs(missing).sum())
        return float(np.clip(slope @ missing / (slope @ slope), -most, most))

    def _aim(self, goal: float) -> None:
        """Forget what was learned about another target."""
        self._target, self._side, self._reversals, self._streak, self._stalls = goal, 0, 0, 0, 0
        self._last, self._jumped = None, {}

    def _share(self, goal: float, measured: float, at: float) -> float:
        """γ; the last step shows where jumps are."""
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
                self._jumped[direction] = 0.5 * (u + at) if abs(at - u) > 2 * self.config.margin else u
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
