"""The closed loop: measure the force, ask the law, actuate the plant, step after step."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8

from exosight.control.estimator import Estimator, OnnxEstimator
from exosight.control.frame_history import FrameHistory
from exosight.control.laws import Law
from exosight.control.plant import Observation, Plant
from exosight.errors import InputError

RATE = 10.0
"""Steps of the loop a second [Hz]; not printed in the paper."""

Measure = Callable[[Observation], float]
"""What the law is told about an observation: F_net [N], from the image or, for comparison, the true one."""


def from_image(estimator: Estimator) -> Measure:
    """F_net as an estimator reads it from the image: the sum of its C1…C7.

    A network is shown earlier images and u as well, if its card asks for them.
    """
    if not isinstance(estimator, OnnxEstimator):
        return lambda observation: float(estimator.estimate(observation.image[None])[0].sum())
    history = FrameHistory(estimator.card)

    def measure(observation: Observation) -> float:
        image = observation.image
        return float(estimator.estimate(image[None], history.inputs(image, observation.u))[0].sum())

    return measure


def true_force(observation: Observation) -> float:
    """F_net as the simulation knows it: closes the loop on a perfect sensor, and needs no trained network."""
    return observation.net_force


@dataclass(frozen=True)
class Record:
    """One run of the loop, a row a step; row 0 is the plant as it was reset.

    Row k holds u_k and what the plant shows under it: u_k comes from the target of row k and the measurement
    of row k − 1.

    time             (steps,)                 [s]
    target           (steps,)                 F_t [N]
    F_net_true       (steps,)                 of the plant [N]
    F_net_estimated  (steps,)                 what the law was told [N]: the same, if `measure` was true_force
    u                (steps,)                 actuation that the law asked for [N]
    images           (steps, height, width)   what the camera saw, gray 0…255
    q                (steps, dofs)            coordinates of the poses (radians, dimensionless strains)
    converged        (steps,)                 False: the plant stayed in an earlier stable pose
    """

    time: Float[np.ndarray, " steps"]
    target: Float[np.ndarray, " steps"]
    F_net_true: Float[np.ndarray, " steps"]
    F_net_estimated: Float[np.ndarray, " steps"]
    u: Float[np.ndarray, " steps"]
    images: UInt8[np.ndarray, "steps height width"]
    q: Float[np.ndarray, "steps dofs"]
    converged: Bool[np.ndarray, " steps"]

    @property
    def error(self) -> Float[np.ndarray, " steps"]:
        """e: target − measured force at the end of each step [N]."""
        return self.target - self.F_net_estimated


def hold(force: float, steps: int) -> Float[np.ndarray, " steps"]:
    """A constant target [N] for so many steps.

    Raises InputError for a force that is negative or no finite number, or less than one step.
    """
    if not 0 <= force < np.inf:
        raise InputError(f"target force: expected a finite number of at least 0 N, got {force}")
    if steps < 1:
        raise InputError(f"target: expected at least 1 step, got {steps}")
    return np.full(steps, float(force))


def hold_and_release(force: float, steps: int) -> Float[np.ndarray, " steps"]:
    """The target of a step response: a force [N], then 0 N, each for so many steps."""
    return np.concatenate([hold(force, steps), hold(0.0, steps)])


def run(
    plant: Plant, law: Law, measure: Measure, target: Float[np.ndarray, " steps"], rate: float = RATE
) -> Record:
    """Reset plant and law, then follow the target: u_k from F_t,k and F_net,k−1, applied and looked at.

    The plant comes to rest within each step (quasi-static), so the rate only sets the times.

    target   (steps,)  F_t of each step [N]; that of row 0 is on record but not acted on
    rate     steps a second [Hz]

    Raises InputError for a target that is empty or not finite, or a rate that is not above 0.
    """
    if target.ndim != 1 or len(target) == 0 or not np.isfinite(target).all():
        raise InputError(
            f"target: expected finite newtons of shape (steps,), at least one, got shape {target.shape}"
        )
    if not 0 < rate < np.inf:
        raise InputError(f"rate: expected a finite number above 0 Hz, got {rate}")
    law.reset()
    seen = [plant.reset()]
    measured = [measure(seen[0])]
    u = [0.0]
    for force in target[1:]:
        u.append(law.next(float(force), measured[-1]))
        seen.append(plant.apply(u[-1]))
        measured.append(measure(seen[-1]))
    return Record(
        time=np.arange(len(target)) / rate,
        target=target.astype(np.float64),
        F_net_true=np.array([o.net_force for o in seen]),
        F_net_estimated=np.array(measured),
        u=np.array(u),
        images=np.stack([o.image for o in seen]),
        q=np.stack([o.q for o in seen]),
        converged=np.array([o.converged for o in seen]),
    )
