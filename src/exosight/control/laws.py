"""Control laws: from target and measured force to the next actuation."""

import math
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np

from exosight.control.paths import ControllerConfig
from exosight.errors import InputError
from exosight.system.schema import Channel


@runtime_checkable
class Law(Protocol):
    """A feedback law; it may have a state of its own."""

    def reset(self) -> None:
        """Return to the initial state, at u = 0."""
        ...

    def next(self, target: float, measured: float) -> float:
        """The command u [the channel's unit] for the coming step.

        target    of that step [the sensor's unit]
        measured  what the sensor reads under the present command [its unit]
        """
        ...


@dataclass
class Proportional:
    """The paper's law: u_k = u_{k−1} + K_P e_k with e_k = target − measured, u_0 = 0, clipped to the
    channel's range.

    As u is summed up, it acts as an integrator on the sensor: the only pose it rests in has no error. The sum
    itself is clipped, so it does not wind up at the limit. A measurement that is no finite number (a lost
    frame) leaves u as it is.

    gain     K_P [the channel's unit per that of the sensor]
    channel  that it drives

    Raises InputError unless the gain is a finite number above 0.
    """

    gain: float
    channel: Channel
    _u: float = field(init=False, repr=False, default=0.0)

    def __post_init__(self) -> None:
        if not 0 < self.gain < math.inf:
            raise InputError(f"gain K_P: expected a finite number above 0, got {self.gain}")

    def reset(self) -> None:
        """Return to u_0 = 0."""
        self._u = 0.0

    def next(self, target: float, measured: float) -> float:
        """The command u_k [the channel's unit].

        target    [the sensor's unit]
        measured  under u_{k−1} [the sensor's unit]

        Raises InputError if the target is no finite number.
        """
        if not math.isfinite(target):
            raise InputError(f"target: expected a finite number, got {target}")
        if math.isfinite(measured):
            wanted = self._u + self.gain * (target - measured)
            self._u = max(self.channel.low, min(self.channel.high, wanted))
        return self._u


@dataclass(frozen=True)
class OpenLoop:
    """No feedback: the command at which the solved path up first shows the target, whatever is measured."""

    config: ControllerConfig

    def reset(self) -> None:
        """Nothing to forget."""

    def next(self, target: float, measured: float) -> float:
        """The command u = U↑(target) [the channel's unit]; 0 for no target.

        Raises InputError if the target is no finite number.
        """
        if not math.isfinite(target):
            raise InputError(f"target: expected a finite number, got {target}")
        return float(np.interp(target, *self.config.loading.inverse())) if target > 0 else 0.0
