"""Control laws: from target and measured force to the next actuation."""

import math
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np

from exosight.control.paths import ControllerConfig
from exosight.control.plant import ACTUATION_LIMIT
from exosight.errors import InputError


@runtime_checkable
class Law(Protocol):
    """A feedback law; what it remembers between steps is its own affair."""

    def reset(self) -> None:
        """Forget everything: the plant stands at u = 0."""
        ...

    def next(self, target: float, measured: float) -> float:
        """The actuation u [N] for the coming step.

        target    F_t of that step [N]
        measured  F_net under the present actuation [N]
        """
        ...


@dataclass
class Proportional:
    """The paper's law: u_k = u_{k−1} + K_P e_k with e_k = F_t − F_net, u_0 = 0, clipped to ±limit.

    As u is summed up, it acts as an integrator on F_net: the only pose it rests in has no error. The sum
    itself is clipped, so it does not wind up at the limit. A measurement that is no finite number (a lost
    frame) leaves u as it is.

    gain   K_P [N/N]
    limit  largest |u| [N]

    Raises InputError unless both are finite numbers above 0.
    """

    gain: float
    limit: float = ACTUATION_LIMIT
    _u: float = field(init=False, repr=False, default=0.0)

    def __post_init__(self) -> None:
        for name, value, unit in (("gain K_P", self.gain, "N/N"), ("limit", self.limit, "N")):
            if not 0 < value < math.inf:
                raise InputError(f"{name}: expected a finite number above 0 {unit}, got {value}")

    def reset(self) -> None:
        """Return to u_0 = 0."""
        self._u = 0.0

    def next(self, target: float, measured: float) -> float:
        """The actuation u_k [N].

        target    F_t [N]
        measured  F_net under u_{k−1} [N]

        Raises InputError if the target is no finite number.
        """
        if not math.isfinite(target):
            raise InputError(f"target force: expected a finite number of newtons, got {target}")
        if math.isfinite(measured):
            self._u = max(-self.limit, min(self.limit, self._u + self.gain * (target - measured)))
        return self._u


@dataclass(frozen=True)
class OpenLoop:
    """No feedback: the load at which the solved path up first shows the target, whatever is measured."""

    config: ControllerConfig

    def reset(self) -> None:
        """Nothing to forget."""

    def next(self, target: float, measured: float) -> float:
        """The actuation u = U↑(F_t) [N]; 0 for no target.

        Raises InputError if the target is no finite number.
        """
        if not math.isfinite(target):
            raise InputError(f"target force: expected a finite number of newtons, got {target}")
        return float(np.interp(target, *self.config.loading.inverse())) if target > 0 else 0.0
