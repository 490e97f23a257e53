"""Ctrl-C and SIGTERM end every command within two seconds, whatever it is doing.

A signal raises `Stopped` in the main thread, so that files and devices are closed in good order. That
alone does not suffice: Python looks at signals between its own instructions, and compiling takes seconds;
what is raised within a callback or a finaliser (JAX has both) is dropped, and the work goes on; a pool waits
for its threads. So the signal also wakes a thread, which ends the process once its time is over. That loses
nothing: a file takes its name when it is whole.

A stopped process ends without taking the interpreter down, in which native threads that still run crash.
"""

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

from exosight.files import discard_unfinished

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C; what schedulers such as SLURM send some seconds before they kill; a terminal that is closed."""

PATIENCE = 1.0
"""How long a stopped command may take to close what it has open, if it does not ask for more [s]."""

_SHOW_CURSOR = "\x1b[?25h\n"  # a progress bar hides it


class Stopped(KeyboardInterrupt):
    """A signal asked the command to stop."""


class Stop:
    """What this process knows of its stop; there is one, `STOP`, as signals are the whole process's."""

    def __init__(self) -> None:
        self.signal = 0
        """that came first; 0: none"""
        self.words = "stopped"
        """what the user is told then"""
        self.patience = PATIENCE
        """how long a stopped command may take to end by itself [s]; a command that needs longer says so"""
        self._ending = threading.Lock()

    def check(self) -> None:
        """Raise `Stopped` if a signal has come, as a loop may ask whose exception was dropped."""
        if self.signal:
            raise Stopped

    def end(self) -> NoReturn:
        """Tell of the stop and end this process at once, with the exit code that shells give a signal."""
        with self._ending:  # whoever comes second waits here until the process is gone
            for child in multiprocessing.active_children():
                child.terminate()
            discard_unfinished()
            cursor = _SHOW_CURSOR if os.isatty(2) else ""
            os.write(2, f"{cursor}exosight: {self.words}\n".encode())
            os._exit(self.exit_code)

    @property
    def exit_code(self) -> int:
        """128 and the signal's number."""
        return 128 + (self.signal or signal.SIGINT)

    def _came(self, number: int, frame: FrameType | None) -> None:
        self.signal = self.signal or number
        if not self._ending.locked() and not _imports(frame):
            raise Stopped

    def _watch(self, pipe: int) -> None:
        number = 0
        while number not in SIGNALS:  # others are handled too, such as SIGCHLD
            number = os.read(pipe, 1)[0]
        self.signal = self.signal or number
        time.sleep(self.patience)
        self.end()


STOP = Stop()


def _imports(frame: FrameType | None) -> bool:
    """Whether a module is being imported: native ones abort the process where Python raises within them.

    The thread that watches ends the process then.
    """
    while frame is not None and not frame.f_code.co_filename.startswith("<frozen importlib"):
        frame = frame.f_back
    return frame is not None


@contextmanager
def stoppable(*, watched: bool) -> Iterator[None]:
    """Raise `Stopped` in what runs within when a signal comes, and behind it if the exception got lost.

    Python shows what a callback or a finaliser raises and drops; a stop is not shown.

    A signal that is ignored, as under nohup, stays so.

    watched   end the process where the main thread does not in time: for a process that does nothing else
    """
    STOP.signal, STOP.words, STOP.patience = 0, "stopped", PATIENCE
    if threading.current_thread() is not threading.main_thread():  # which alone may handle signals
        yield
        return
    before = {kind: signal.getsignal(kind) for kind in SIGNALS}
    kinds = [kind for kind, handler in before.items() if handler is not signal.SIG_IGN]
    if watched:
        pipe, wake = os.pipe()
        os.set_blocking(wake, False)
        signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
        threading.Thread(target=STOP._watch, args=(pipe,), daemon=True, name="stop").start()
    unraisable = sys.unraisablehook
    sys.unraisablehook = lambda lost: None if lost.exc_type is Stopped else unraisable(lost)
    for kind in kinds:
        signal.signal(kind, STOP._came)
    try:
        yield
        STOP.check()
    except BaseException:  # while a library is imported, a stop comes as an error of that library
        STOP.check()
        raise
    finally:
        sys.unraisablehook = unraisable
        for kind in kinds:
            signal.signal(kind, before[kind])
