"""A recording's frames through network and guard once more."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int8, UInt8

from exosight.control.estimator import Reading
from exosight.control.guard import Guarded, Measurement
from exosight.control.recording import STATES, Recording
from exosight.control.scheduled import Scheduled
from exosight.errors import DataError


@dataclass(frozen=True, eq=False)
class Replay:
    """A recording's frames through network and guard once more.

    Rows without an estimate hold zeros, as those of the recording do.
    """

    estimated: Float32[np.ndarray, "steps outputs"]
    """by the network [each in its sensor's unit]"""
    command: Float[np.ndarray, " steps"]
    """that would be asked for [the channel's unit], were the next frames the same"""
    state: Int8[np.ndarray, " steps"]
    """of the guard"""


def replay(recording: Recording, read: Callable[[UInt8[np.ndarray, "1 height width"]], Reading]) -> Replay:
    """What network and guard answer to the frames of a recording: with the same network, the same again.

    read   `OnnxEstimator.read` of the same network, or of another one to compare

    Raises InputError if the network takes pictures of another size, or reads off other sensors; DataError if
    an image is damaged.
    """
    guarded = Guarded(Scheduled(recording.controller), recording.guard)
    estimated, state = np.zeros_like(recording.estimated), recording.state.copy()
    command = np.zeros(len(recording))
    for i, image in enumerate(recording.images()):
        measurement = Measurement()
        if recording.has_frame[i]:
            try:
                reading = read(image[None])
                estimated[i] = reading.forces[0]
            except DataError:  # no finite number, which is no answer
                reading = None
            reported = recording.reported[i]
            measurement = Measurement(
                image,
                reading,
                float(recording.age[i]),
                None if np.isnan(reported).all() else reported,
            )
        command[i] = guarded.step(float(recording.target[i]), measurement, int(recording.missed[i]))
        state[i] = STATES.index(guarded.state)
    return Replay(estimated, command, state)
