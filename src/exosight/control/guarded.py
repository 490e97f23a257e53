"""The loop with a controller that judges its frames, and the measurements that it needs."""

from collections.abc import Callable
from typing import Literal

import numpy as np
from jaxtyping import Float

from exosight.control.adaptive import Adaptive
from exosight.control.estimator import Reader, Reading, read_one, read_under
from exosight.control.guard import GuardConfig, Guarded, Measurement
from exosight.control.loop import Record, run
from exosight.control.paths import ControllerConfig
from exosight.control.plant import Observation, Plant
from exosight.control.policy_file import LearnedPolicy
from exosight.control.scheduled import Scheduled
from exosight.errors import InputError
from exosight.system.schema import difference

Sense = Callable[[Observation], Measurement]
"""The measurement that the guard gets of an observation; wrap it to delay, drop or corrupt frames."""

GuardedName = Literal["guarded", "adaptive"]
"""The scheduled law behind its guard, or the adaptive controller."""


def guarded_of(
    name: GuardedName | LearnedPolicy, config: ControllerConfig, guard: GuardConfig | None = None
) -> Guarded | Adaptive:
    """A new controller of this name, or with this policy, with the settings that it has by default.

    guard   when a frame is bad

    Raises InputError for a policy that was trained for another loop.
    """
    if isinstance(name, LearnedPolicy):
        return name.controller(config, guard=guard)
    if name == "adaptive":
        return Adaptive(config, guard=guard)
    return Guarded(Scheduled(config), guard or GuardConfig())


def measurement_from(estimator: Reader) -> Sense:
    """Picture, estimate, interval and score; None for an estimate that is not finite, or of no picture.

    A network that takes commands gets those of the observation.
    """

    def sense(observation: Observation) -> Measurement:
        reading = read_one(read_under(estimator, observation.commands), observation.image)
        return Measurement(observation.image, reading, commands=observation.commands)

    return sense


def true_measurement(observation: Observation) -> Measurement:
    """The picture with the true readings of the estimated sensors: intervals of no
    width."""
    outputs = observation.outputs[None].astype(np.float32)
    pressing = (outputs > 0).astype(np.float32)
    score = np.zeros(1, np.float32)
    reading = Reading(outputs, outputs, outputs, pressing, score)
    return Measurement(observation.image, reading, commands=observation.commands)


def run_guarded(
    plant: Plant, guarded: Guarded | Adaptive, sense: Sense, target: Float[np.ndarray, " steps"]
) -> Record:
    """Reset plant and controller, then follow the target, as `run` does; `guarded.log` lists its states.

    `estimated` of the record is NaN where no estimate came.

    target   (steps,)  of each step [the sensor's unit]; that of row 0 is on record but not acted on

    Raises InputError for a target that is empty or not finite, or a plant of another schema than the
    controller was tuned for.
    """
    config = guarded.config
    found = difference(config.schema, plant.schema)
    if found:
        raise InputError(
            f"controller: the plant is not the one that it was tuned for: {found}; tune it again"
        )
    driver = _Driver(guarded, sense)
    return run(plant, driver, driver.measure, target, config.sensor, config.channel, rate=1 / config.period)


class _Driver:
    """A guarded controller as law and measurement of `run`: each measurement is acted on once."""

    def __init__(self, guarded: Guarded | Adaptive, sense: Sense) -> None:
        self._guarded, self._sense, self._measurement = guarded, sense, Measurement()

    def reset(self) -> None:
        self._guarded.reset()

    def measure(self, observation: Observation) -> float:
        found: object = self._sense(observation)
        self._measurement = found if isinstance(found, Measurement) else Measurement()
        return self._measurement.sum(self._guarded.config.weights)

    def next(self, target: float, measured: float) -> float:
        return self._guarded.step(target, self._measurement)
