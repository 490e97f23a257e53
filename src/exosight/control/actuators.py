"""What carries the command to the plant; a class of one's own with these two methods is one too."""

import sys
from contextlib import suppress
from io import RawIOBase
from pathlib import Path
from typing import Protocol, runtime_checkable

from exosight.errors import DataError


@runtime_checkable
class Actuator(Protocol):
    """What applies u to the plant, step after step.

    It should return to u = 0 by itself without a command for half a second: no program can do so after a
    power cut.
    """

    def apply(self, u: float) -> None:
        """Take u [the unit of its channel], which is within the limits of the controller; return soon, the
        loop waits.
        """
        ...

    def close(self) -> None:
        """Return to u = 0 at once, and need no further call; called once, however the loop ended."""
        ...


class NoActuator:
    """None: commands are computed, and nothing is actuated."""

    def apply(self, u: float) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


class Lines:
    """One line a step with u in the unit of its channel, "2.3750", for a program or device that reads them.

    stream  of bytes, not buffered
    """

    def __init__(self, stream: RawIOBase) -> None:
        self._stream = stream

    @staticmethod
    def open(place: str) -> "Lines":
        """Lines to a new file, a named pipe or a serial device; "-" is stdout.

        Raises DataError if the place cannot be written, or is a file that is there already.
        """
        if place == "-":
            return Lines(open(sys.stdout.fileno(), "wb", buffering=0, closefd=False))
        path = Path(place)
        if path.is_file():
            raise DataError(f"{path}: exists already; name a new file, nothing is overwritten")
        try:
            return Lines(path.open("ab", buffering=0))  # a device cannot be truncated
        except OSError as error:
            raise DataError(f"{path}: cannot be written ({error.strerror}); name another place") from error

    def apply(self, u: float) -> None:
        """Write one line; DataError if it can no longer be written."""
        try:
            self._stream.write(b"%.4f\n" % u)
        except (OSError, ValueError) as error:  # ValueError: the stream is closed
            raise DataError(f"u cannot be sent ({error}); look after the actuator") from error

    def close(self) -> None:
        """Write 0.0000 as the last line, if it can be written."""
        with suppress(DataError):
            self.apply(0.0)
        self._stream.close()
