"""A recording's frames through network and guard once more."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int8

from exosight.control.estimator import Read, Reader, read_under
from exosight.control.guard import Measurement
from exosight.control.recording import STATES, Recording
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


def replay(recording: Recording, network: Reader | Read) -> Replay:
    """What network and controller answer to the frames of a recording: with the same network, the same again.

    network   the same, or another one to compare

    Raises InputError if the network takes pictures of another size, or reads off other sensors; DataError if
    an image is damaged.
    """
    guarded = recording.guarded()
    estimated, state = np.zeros_like(recording.estimated), recording.state.copy()
    command = np.zeros(len(recording))
    for i, image in enumerate(recording.images()):
        measurement = Measurement()
        if recording.has_frame[i]:
            try:
                reading = read_under(network, recording.shown[i])(image[None])
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
