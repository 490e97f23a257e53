"""The other end of `Lines`: what a driver does with them, and when it releases by itself.

A line is "NUMBER NAME VALUE UNIT", such as "17 pressure 31.2500 kPa", with numbers from 0. A driver holds the
value of the newest line, and releases where none has come for some time.
"""

import math
from collections.abc import Callable
from time import monotonic

from exosight.errors import InputError

LONGEST = 128
"""Of a line [bytes]; what is longer is none."""


class LineReceiver:
    """The newest value of one actuator.

    name, unit   of it; other lines are refused
    silence      after which it is released [s]; several periods of the loop
    released     value without a line [unit]
    now          clock [s]

    `missed` counts lines that did not arrive, `refused` those that were none, of others or overtaken.

    Raises InputError for a silence that is not above 0.
    """

    def __init__(
        self,
        name: str,
        unit: str,
        silence: float = 0.5,
        released: float = 0.0,
        now: Callable[[], float] = monotonic,
    ) -> None:
        if not 0 < silence < math.inf:
            raise InputError(f"silence: expected a finite time above 0 s, got {silence}")
        self.name, self.unit, self.silence, self.released = name, unit, silence, released
        self.missed, self.refused = 0, 0
        self._now, self._rest, self._number = now, b"", -1
        self._newest: tuple[float, float] | None = None  # value, and when it came

    def take(self, data: bytes) -> None:
        """What has arrived, in pieces of any length."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LONGEST:
            self._rest, self.refused = b"", self.refused + 1
        for line in lines:
            self._line(line)

    @property
    def value(self) -> float:
        """What the actuator is to do now [unit]."""
        return self.released if self._silent or self._newest is None else self._newest[0]

    @property
    def _silent(self) -> bool:
        return self._newest is None or self._now() - self._newest[1] > self.silence

    def _line(self, line: bytes) -> None:
        try:
            number, name, value, unit = line.decode().split(" ", 3)
            count, found = int(number), float(value)
        except ValueError:  # no text, other parts, no numbers
            count, name, unit, found = -1, "", "", math.nan
        if count < 0 or name != self.name or unit != self.unit or not math.isfinite(found):
            self.refused += 1
            return
        if self._newest is None:
            self._number = count - 1
        elif self._silent:  # whoever sends may have begun anew
            self._number = min(self._number, count - 1)
        if count <= self._number:  # datagrams may overtake each other
            self.refused += 1
            return
        self.missed += count - self._number - 1
        self._number, self._newest = count, (found, self._now())
