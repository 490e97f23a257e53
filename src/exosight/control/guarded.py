"""The loop with a guard in it, and the eyes that it needs."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from exosight.control.estimator import Reader, Reading, read_one
from exosight.control.guard import Guarded, Measurement
from exosight.control.loop import Record, run
from exosight.control.plant import Observation, Plant

Sense = Callable[[Observation], Measurement]
"""What the guard is shown of an observation; wrap it to delay, drop or spoil frames."""


def measurement_from(estimator: Reader) -> Sense:
    """Picture, estimate, interval and score; a network that answers no number has answered nothing."""

    def sense(observation: Observation) -> Measurement:
        return Measurement(observation.image, read_one(estimator.read, observation.image), u=observation.u)

    return sense


def true_measurement(observation: Observation) -> Measurement:
    """The picture with the forces that the simulation knows: a perfect estimator, sure of itself."""
    forces = observation.forces[None, 1:].astype(np.float32)
    pressing = (forces > 0).astype(np.float32)
    return Measurement(
        observation.image, Reading(forces, forces, forces, pressing, np.zeros(1, np.float32)), u=observation.u
    )


def run_guarded(plant: Plant, guarded: Guarded, sense: Sense, target: Float[np.ndarray, " steps"]) -> Record:
    """Reset plant and controller, then follow the target, as `run` does; `guarded.log` tells what happened.

    F_net_estimated of the record is NaN where no estimate came.

    target   (steps,)  F_t of each step [N]; that of row 0 is on record but not acted on

    Raises InputError for a target that is empty or not finite.
    """
    driver = _Driver(guarded, sense)
    return run(plant, driver, driver.measure, target, rate=1 / guarded.config.period)


class _Driver:
    """A guarded controller as law and measurement of `run`: each measurement is acted on once."""

    def __init__(self, guarded: Guarded, sense: Sense) -> None:
        self._guarded, self._sense, self._measurement = guarded, sense, Measurement()

    def reset(self) -> None:
        self._guarded.reset()

    def measure(self, observation: Observation) -> float:
        self._measurement = self._sense(observation)
        return self._measurement.net_force

    def next(self, target: float, measured: float) -> float:
        return self._guarded.step(target, self._measurement)
