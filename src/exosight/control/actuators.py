"""What carries the command to the plant; a class of one's own with these two methods is one too."""

import os
import re
import socket
import stat
import sys
from collections.abc import Callable
from contextlib import suppress
from io import FileIO, RawIOBase
from pathlib import Path
from typing import Protocol, runtime_checkable

from exosight.errors import DataError, InputError

BAUD = 115_200
"""Speed of a serial device unless its place says another [bits a second]."""
UDP = "udp://"
"""What places begin with that lines are sent to by network."""

_SERIAL = re.compile(r"(?P<path>/dev/.+?)(?:@(?P<baud>[0-9]{1,8}))?")
_PLACE = re.compile(r"udp://(?P<host>[^:/@\s]+|\[[0-9A-Fa-f:.]+\]):(?P<port>[0-9]{1,5})")


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
    """One line a step, "17 u 2.3750 N", for a program or device that reads them, see `LineReceiver`.

    It is a heartbeat too: number, from 0, name, value and unit, at every step, whether the value changed or
    not; the last line releases. Whoever reads releases by itself where no line comes.

    stream      of bytes, not buffered
    name, unit  of what is sent
    command     what is sent for a load, such as `ActuatorCurve.at`; by default the load itself
    """

    def __init__(
        self,
        stream: RawIOBase,
        name: str,
        unit: str,
        command: Callable[[float], float] = lambda load: load,
    ) -> None:
        self._stream, self._name, self._unit, self._command = stream, name, unit, command
        self._count = 0

    @staticmethod
    def open(
        place: str, name: str, unit: str, command: Callable[[float], float] = lambda load: load
    ) -> "Lines":
        """Lines to a new file, a named pipe, a serial device, or a program on the network; "-" is stdout.

        A serial device, "/dev/ttyUSB0" or "/dev/ttyUSB0@9600", gets bytes of 8 bits without parity or flow
        control, at BAUD unless its place says another speed. "udp://HOST:PORT" gets a datagram a line.

        Raises DataError if the place cannot be written, or is a file that is there already; InputError for a
        speed that serial devices do not have, or a network place that is none.
        """
        return Lines(_stream(place), name, unit, command)

    def apply(self, u: float) -> None:
        """Write one line; DataError if it can no longer be written, or if nobody reads what was written."""
        line = f"{self._count} {self._name} {self._command(u):.4f} {self._unit}\n".encode()
        self._count += 1
        try:
            written = self._stream.write(line)
        except (OSError, ValueError) as error:  # ValueError: the stream is closed
            raise DataError(f"u cannot be sent ({error}); look after the actuator") from error
        if written != len(line):
            raise DataError("u cannot be sent (whoever reads it has stopped); look after the actuator")

    def close(self) -> None:
        """Write the command of no load as the last line, if it can be written."""
        with suppress(DataError):
            self.apply(0.0)
        self._stream.close()


def _stream(place: str) -> RawIOBase:
    """Where `Lines.open` writes."""
    if place == "-":
        return open(sys.stdout.fileno(), "wb", buffering=0, closefd=False)
    if place.startswith(UDP):
        return _datagrams(place)
    path, baud = serial_place(place)
    if path.is_file():
        raise DataError(f"{path}: exists already; name a new file, nothing is overwritten")
    try:
        stream = path.open("ab", buffering=0)  # a device cannot be truncated
        try:
            _prepare(stream.fileno(), path, baud)
        except BaseException:
            stream.close()
            raise
        return stream
    except OSError as error:
        raise DataError(f"{path}: cannot be written ({error.strerror}); name another place") from error


def serial_place(place: str) -> tuple[Path, int | None]:
    """The path in a place that lines go to, and the speed that it says [bits a second].

    Raises InputError for a speed that serial devices do not have.
    """
    found = _SERIAL.fullmatch(place)
    if found is None or found["baud"] is None:
        return Path(place), None
    baud = int(found["baud"])
    if baud not in _speeds():
        shown = ", ".join(str(speed) for speed in sorted(_speeds()) if speed >= 1200)
        raise InputError(f"--send: expected one of the speeds {shown}, got {baud}")
    return Path(found["path"]), baud


def _speeds() -> dict[int, int]:
    """Speeds of serial devices [bits a second], with what the system calls them; none on Windows."""
    try:
        import termios
    except ModuleNotFoundError:
        return {}
    names = (name for name in dir(termios) if re.fullmatch(r"B[1-9][0-9]*", name))
    return {int(name[1:]): getattr(termios, name) for name in names}


def _prepare(descriptor: int, path: Path, baud: int | None) -> None:
    """Set up a serial device; of it and of a pipe, let no write wait for a reader that has stopped."""
    if os.isatty(descriptor) and _speeds():
        import termios
        import tty

        try:
            tty.setraw(descriptor, termios.TCSANOW)
            settings = termios.tcgetattr(descriptor)
            settings[2] &= ~(getattr(termios, "CRTSCTS", 0) | termios.CSTOPB)
            settings[2] |= termios.CLOCAL
            settings[4] = settings[5] = _speeds()[baud or BAUD]
            termios.tcsetattr(descriptor, termios.TCSANOW, settings)
        except termios.error as error:
            raise DataError(
                f"{path}: cannot be set to {baud or BAUD} bits a second ({error.args[-1]})"
            ) from error
    elif baud is not None:
        raise InputError(f"{path}: no serial device, so it has no speed; leave out @{baud}")
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.set_blocking(descriptor, False)


def _datagrams(place: str) -> RawIOBase:
    """A stream that sends each write as a datagram."""
    found = _PLACE.fullmatch(place)
    if found is None or not 1 <= int(found["port"]) <= 65_535:
        raise InputError(f"--send: expected udp://HOST:PORT, such as udp://192.168.1.20:5005, got {place!r}")
    try:
        (kind, *_, address), *_ = socket.getaddrinfo(
            found["host"].strip("[]"), int(found["port"]), type=socket.SOCK_DGRAM
        )
        with socket.socket(kind, socket.SOCK_DGRAM) as sender:
            sender.connect(address)
            sender.setblocking(False)
            return FileIO(sender.detach(), "wb")  # each write to a connected socket is a datagram
    except OSError as error:
        raise DataError(f"{place}: cannot be reached ({error.strerror}); name another place") from error
