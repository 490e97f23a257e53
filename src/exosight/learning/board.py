"""Loss curves as TensorBoard reads them, written by the thread that trains.

`tensorboardX.SummaryWriter` writes in a thread of its own: a full disk ends that one, and training then waits
for it without end.
"""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from tensorboardX.event_file_writer import EventsWriter
from tensorboardX.proto.event_pb2 import Event, SessionLog  # pyright: ignore[reportAttributeAccessIssue]
from tensorboardX.summary import scalar

from exosight.files import write_error

BOARD_NAME = "tensorboard"
"""Folder of the loss curves within a run's: `tensorboard --logdir` the folder above."""


class Board:
    """A new file of curves, also for a run that goes on within the second in which it was stopped.

    run    folder of the run; None: nothing is written, as by all processes of a group but the first
    step   of the run's start, from which on TensorBoard forgets what earlier files hold

    Its methods raise DataError if the file cannot be written.
    """

    def __init__(self, run: Path | None, step: int) -> None:
        self._writer: EventsWriter | None = None
        if run is None:
            return
        self._folder = run / BOARD_NAME
        with self._told():
            self._folder.mkdir(exist_ok=True)
            self._writer = EventsWriter(str(self._folder / "events"), f".{step}")
            self._writer.write_event(Event(step=step + 1, session_log=SessionLog(status=SessionLog.START)))

    def add(self, curves: Mapping[str, float], step: int) -> None:
        """One more point of each curve."""
        if self._writer is None:
            return
        with self._told():
            for name, value in curves.items():
                self._writer.write_event(Event(wall_time=time.time(), step=step, summary=scalar(name, value)))
            self._writer.flush()

    def close(self) -> None:
        """Close the file."""
        if self._writer is not None:
            with self._told():
                self._writer.close()

    @contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise write_error(self._folder, error) from error
