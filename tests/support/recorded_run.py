"""A run of the loop on made-up pictures and a made-up network, recorded."""

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from exosight.control import Adaptive, ControllerConfig, GuardConfig, Guarded, Scheduled
from exosight.control.estimator import Reading
from exosight.control.realtime import Clock, Step, run_live
from exosight.control.recording import Recorder
from exosight.control.sources import Frame
from exosight.errors import DataError

SHAPE = (4, 6)
MODEL = Path(__file__)
"""In the place of a network's file."""


def read(images: np.ndarray) -> Reading:
    """A made-up network: the force on C3 is a gray value, of which 255 is no number."""
    gray = int(images[0, 0, 0])
    if gray == 255:
        raise DataError("the network answers forces that are not finite")
    forces = np.zeros((1, 7), np.float32)
    forces[0, 2] = gray / 500
    return Reading(forces, forces - 0.001, forces + 0.001, forces, np.array([0.1], np.float32))


def frames(count: int, clock: Clock) -> Iterator[Frame | None]:
    """Pictures of a force that comes and goes, a few of them lost or unreadable."""
    for i in range(count):
        image = np.zeros(SHAPE, np.uint8)
        image[0, 0] = 255 if i == 7 else int(100 + 80 * np.sin(i / 4))
        image[1, i % 6] = 200
        yield None if i in (11, 12, 13) else Frame(image, clock.now(), None, np.full(7, 0.01 * i))


def run(
    path: Path, config: ControllerConfig, count: int = 47, guarded: Guarded | Adaptive | None = None
) -> list[Step]:
    """Record a run; the network's file is any file."""
    steps: list[Step] = []
    moment = itertools.count()
    guarded = guarded or Guarded(Scheduled(config), GuardConfig(uncertain_width=0.5))
    recorder = Recorder(path, SHAPE, guarded, MODEL)

    class Hand:
        def apply(self, u: float) -> None:
            pass

        def close(self) -> None:
            pass

    def done(step: Step) -> None:
        steps.append(step)
        recorder.append(step)

    clock = Clock(lambda: next(moment) / 1000, lambda seconds: None)
    run_live(frames(count, clock), read, guarded, Hand(), [0.3] * 100, done, clock)
    recorder.close()
    return steps
