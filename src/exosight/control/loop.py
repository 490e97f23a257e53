"""The closed loop: measure the force, evaluate the law, actuate the plant, step after step."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8

from exosight.control.estimator import Estimator, OnnxEstimator
from exosight.control.frame_history import FrameHistory
from exosight.control.laws import Law
from exosight.control.plant import Observation, Plant
from exosight.errors import InputError
from exosight.system.schema import Channel, Schema, SensorSpec

RATE = 10.0
"""Steps of the loop a second [Hz]; not printed in the paper."""

Measure = Callable[[Observation], float]
"""The measurement that the law gets of an observation: one sensor [its unit], from the image or, for
comparison, the true reading."""


def from_image(estimator: Estimator, schema: Schema, sensor: str | None = None) -> Measure:
    """A sensor as an estimator reads it from the image: a sum of the estimator's outputs.

    A network has earlier images and commands as inputs as well, if its card says so.

    schema   of the plant
    sensor   by default the one that the schema controls

    Raises InputError for a network that was not made for such a plant, or a sensor that does not follow from
    what is estimated.
    """
    weights = schema.weights(sensor or schema.controlled).astype(np.float32)
    if not isinstance(estimator, OnnxEstimator):
        return lambda observation: float((estimator.estimate(observation.image[None])[0] * weights).sum())
    estimator.card.check_fits(schema, "plant")
    history = FrameHistory(estimator.card)

    def measure(observation: Observation) -> float:
        image = observation.image
        outputs = estimator.estimate(image[None], history.inputs(image, observation.commands))[0]
        return float((outputs * weights).sum())

    return measure


def true_reading(sensor: str | None = None) -> Measure:
    """The true reading of a sensor: closes the loop on a perfect one, and needs no trained network.

    sensor   by default the one that the plant's schema controls
    """
    return lambda observation: observation.reading(sensor or observation.schema.controlled)


@dataclass(frozen=True)
class Record:
    """One run of the loop, a row a step; row 0 is the plant as it was reset.

    Row k holds u_k and what the plant shows under it: u_k comes from the target of row k and the measurement
    of row k − 1.

    schema      of the plant
    sensor      name of the sensor that follows the target
    channel     name of the channel that was actuated; the others rest at 0
    time        (steps,)                 [s]
    target      (steps,)                 of the sensor [its unit]
    true        (steps,)                 what the sensor reads on the plant [its unit]
    estimated   (steps,)                 measurement that the law got [its unit]
    command     (steps,)                 u that the law asked for [the channel's unit]
    images      (steps, height, width)   what the camera saw, gray 0…255
    q           (steps, dofs)            coordinates of the poses (radians, dimensionless strains)
    converged   (steps,)                 False: the plant stayed in an earlier stable pose
    """

    schema: Schema
    sensor: str
    channel: str
    time: Float[np.ndarray, " steps"]
    target: Float[np.ndarray, " steps"]
    true: Float[np.ndarray, " steps"]
    estimated: Float[np.ndarray, " steps"]
    command: Float[np.ndarray, " steps"]
    images: UInt8[np.ndarray, "steps height width"]
    q: Float[np.ndarray, "steps dofs"]
    converged: Bool[np.ndarray, " steps"]

    @property
    def controlled(self) -> SensorSpec:
        """The sensor that follows the target."""
        return self.schema.sensor(self.sensor)

    @property
    def driven(self) -> Channel:
        """The channel that was actuated."""
        return self.schema.channel(self.channel)

    @property
    def error(self) -> Float[np.ndarray, " steps"]:
        """e: target − measured reading at the end of each step [the sensor's unit]."""
        return self.target - self.estimated


def hold(force: float, steps: int) -> Float[np.ndarray, " steps"]:
    """A constant target [the sensor's unit] for so many steps.

    Raises InputError for a force that is negative or no finite number, or less than one step.
    """
    if not 0 <= force < np.inf:
        raise InputError(f"target force: expected a finite number of at least 0, got {force}")
    if steps < 1:
        raise InputError(f"target: expected at least 1 step, got {steps}")
    return np.full(steps, float(force))


def hold_and_release(force: float, steps: int) -> Float[np.ndarray, " steps"]:
    """The target of a step response: a force, then 0, each for so many steps."""
    return np.concatenate([hold(force, steps), hold(0.0, steps)])


def run(
    plant: Plant,
    law: Law,
    measure: Measure,
    target: Float[np.ndarray, " steps"],
    sensor: str | None = None,
    channel: str | None = None,
    rate: float = RATE,
) -> Record:
    """Reset plant and law, then follow the target: u_k from target k and measurement k − 1, applied and
    looked at.

    The plant comes to rest within each step (quasi-static), so the rate only sets the times.

    target    (steps,)  of each step [the sensor's unit]; that of row 0 is on record but not acted on
    sensor    that follows the target; by default the one that the plant's schema controls
    channel   that the law drives, by default the first; the others rest at 0
    rate      steps a second [Hz]

    Raises InputError for a target that is empty or not finite, a rate that is not above 0, or a name that is
    none of the plant's.
    """
    if target.ndim != 1 or len(target) == 0 or not np.isfinite(target).all():
        raise InputError(
            f"target: expected finite numbers of shape (steps,), at least one, got shape {target.shape}"
        )
    if not 0 < rate < np.inf:
        raise InputError(f"rate: expected a finite number above 0 Hz, got {rate}")
    schema = plant.schema
    driven, sensor = schema.channel(channel), sensor or schema.controlled
    schema.index(sensor)
    law.reset()
    seen = [plant.reset()]
    measured = [measure(seen[0])]
    u = [0.0]
    for force in target[1:]:
        u.append(law.next(float(force), measured[-1]))
        seen.append(plant.apply(schema.commands(u[-1], channel)))
        measured.append(measure(seen[-1]))
    return Record(
        schema=schema,
        sensor=sensor,
        channel=driven.name,
        time=np.arange(len(target)) / rate,
        target=target.astype(np.float64),
        true=np.array([o.reading(sensor) for o in seen]),
        estimated=np.array(measured),
        command=np.array(u),
        images=np.stack([o.image for o in seen]),
        q=np.stack([o.q for o in seen]),
        converged=np.array([o.converged for o in seen]),
    )
