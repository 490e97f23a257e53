"""All episodes of one controller in closed loop, stepped side by side."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from exosight.control.batch import BatchPlant, Joints
from exosight.control.guard import Measurement, Transition
from exosight.control.laws import Law
from exosight.control.stress.episodes import Episode
from exosight.control.stress.frames import FrameDelivery, Sensor
from exosight.errors import InputError


@runtime_checkable
class Controller(Protocol):
    """What drives one plant: `exosight.control.Guarded`, or a law without a guard (`Unguarded`)."""

    log: list[Transition]

    def reset(self) -> None:
        """Forget everything: the plant stands at u = 0."""
        ...

    def step(self, target: float, measurement: Measurement) -> float:
        """The actuation of the coming step [N]."""
        ...


class Unguarded:
    """A law without a guard: it believes whatever it is told, however old, and leaves u where nothing comes.

    law  told F_net [N], not a number where no frame came
    """

    def __init__(self, law: Law) -> None:
        self._law = law
        self.log: list[Transition] = []

    def reset(self) -> None:
        """Forget everything: the plant stands at u = 0."""
        self._law.reset()

    def step(self, target: float, measurement: Measurement) -> float:
        """The actuation of the coming step [N]."""
        return self._law.next(target, measurement.net_force)


@dataclass(frozen=True, eq=False)
class Traces:
    """What happened in all episodes, a row an episode, a column a step; column 0 is at rest.

    target      (episodes, steps)      F_t [N]
    u           (episodes, steps)      asked for [N]
    forces      (episodes, steps, 7)   true, on C1…C7 [N]
    estimated   (episodes, steps)      F_net as the controller was told it before the step; NaN: nothing came
    converged   (episodes, steps)      the plant reached the u asked for
    logs        what each controller's guard did
    """

    target: Float[np.ndarray, "episodes steps"]
    u: Float[np.ndarray, "episodes steps"]
    forces: Float[np.ndarray, "episodes steps 7"]
    estimated: Float[np.ndarray, "episodes steps"]
    converged: Bool[np.ndarray, "episodes steps"]
    logs: tuple[tuple[Transition, ...], ...]

    @property
    def net(self) -> Float[np.ndarray, "episodes steps"]:
        """True F_net [N]."""
        return self.forces.sum(axis=2)


def run_episodes(
    episodes: Sequence[Episode],
    controllers: Sequence[Controller],
    sensor: Sensor,
    done: Callable[[int, int], None] = lambda step, steps: None,
) -> Traces:
    """Every episode with its own controller, all from rest.

    sensor   `camera_sensor(estimator)`, or `true_sensor` for the forces of the simulation
    done     called with (steps done, steps in all)

    Raises InputError for no episodes, episodes of several lengths, or another number of controllers.
    """
    lengths = {len(episode.target) for episode in episodes}
    if len(lengths) != 1 or len(controllers) != len(episodes):
        raise InputError(
            f"episodes: expected one or more of one length, each with a controller, got {len(episodes)} of "
            f"{len(lengths)} lengths and {len(controllers)} controllers"
        )
    (steps,) = lengths
    plant, frames = BatchPlant([episode.exosuit for episode in episodes]), FrameDelivery(episodes, sensor)
    target = np.stack([episode.target for episode in episodes])
    stiffness = np.stack([episode.stiffness for episode in episodes])
    rest = np.stack([episode.rest for episode in episodes])
    for controller in controllers:
        controller.reset()
    u, states, estimated = [np.zeros(len(episodes))], [plant.state], [np.zeros(len(episodes))]
    for step in range(1, steps):
        measurements = frames.measurements(plant, step - 1)
        asked = [
            controller.step(float(goal), measurement)
            for controller, goal, measurement in zip(controllers, target[:, step], measurements, strict=True)
        ]
        u.append(np.array(asked))
        states.append(plant.step(u[-1], Joints(stiffness[:, step], rest[:, step])))
        estimated.append(np.array([measurement.net_force for measurement in measurements]))
        done(step, steps - 1)
    return Traces(
        target=target,
        u=np.stack(u, axis=1),
        forces=np.stack([state.forces[:, 1:] for state in states], axis=1),
        estimated=np.stack(estimated, axis=1),
        converged=np.stack([state.converged for state in states], axis=1),
        logs=tuple(tuple(controller.log) for controller in controllers),
    )
