"""All episodes of one controller in closed loop, stepped side by side."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from exosight.control.batch import BatchPlant, Joints
from exosight.control.guard import Measurement, Transition
from exosight.control.laws import Law
from exosight.control.paths import ControllerConfig
from exosight.control.stress.episodes import Episode
from exosight.control.stress.frames import FrameDelivery, Look
from exosight.errors import InputError


@runtime_checkable
class Controller(Protocol):
    """What drives one plant: `exosight.control.Guarded`, or a law without a guard (`Unguarded`)."""

    log: list[Transition]

    def reset(self) -> None:
        """Return to the initial state, at u = 0."""
        ...

    def step(self, target: float, measurement: Measurement) -> float:
        """The command of the coming step [the driven channel's unit]."""
        ...


class Unguarded:
    """A law without a guard: it acts on every estimate, however old, and leaves u where there is none.

    law      gets the controlled sensor, NaN where no frame came
    weights  (outputs,)  of the estimated sensors in it
    """

    def __init__(self, law: Law, weights: Float[np.ndarray, " outputs"]) -> None:
        self._law, self._weights = law, weights
        self.log: list[Transition] = []

    def reset(self) -> None:
        """Return to the initial state, at u = 0."""
        self._law.reset()

    def step(self, target: float, measurement: Measurement) -> float:
        """The command of the coming step [the driven channel's unit]."""
        return self._law.next(target, measurement.sum(self._weights))


@dataclass(frozen=True, eq=False)
class Traces:
    """What happened in all episodes, a row an episode, a column a step; column 0 is at rest.

    target      (episodes, steps)            of the controlled sensor [its unit]
    command     (episodes, steps)            asked for [the driven channel's unit]
    outputs     (episodes, steps, outputs)   true readings of the estimated sensors [each in its unit]
    true        (episodes, steps)            true reading of the controlled sensor [its unit]
    estimated   (episodes, steps)            that the controller got before the step; NaN: none
    converged   (episodes, steps)            the plant reached the command asked for
    logs        what each controller's guard did
    """

    target: Float[np.ndarray, "episodes steps"]
    command: Float[np.ndarray, "episodes steps"]
    outputs: Float[np.ndarray, "episodes steps outputs"]
    true: Float[np.ndarray, "episodes steps"]
    estimated: Float[np.ndarray, "episodes steps"]
    converged: Bool[np.ndarray, "episodes steps"]
    logs: tuple[tuple[Transition, ...], ...]


def run_episodes(
    episodes: Sequence[Episode],
    controllers: Sequence[Controller],
    look: Look,
    config: ControllerConfig,
    done: Callable[[int, int], None] = lambda step, steps: None,
) -> Traces:
    """Every episode with its own controller, all from rest.

    look     `camera_sensor(estimator)`, or `true_sensor` for true readings
    config   which sensor is controlled and which channel is driven; the others rest at 0
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
    plant, frames = BatchPlant([episode.system for episode in episodes]), FrameDelivery(episodes, look)
    target = np.stack([episode.target for episode in episodes])
    stiffness = np.stack([episode.stiffness for episode in episodes])
    rest = np.stack([episode.rest for episode in episodes])
    for controller in controllers:
        controller.reset()
    command, states, estimated = [np.zeros(len(episodes))], [plant.state], [np.zeros(len(episodes))]
    for step in range(1, steps):
        measurements = frames.measurements(plant, step - 1)
        asked = [
            controller.step(float(goal), measurement)
            for controller, goal, measurement in zip(controllers, target[:, step], measurements, strict=True)
        ]
        command.append(np.array(asked))
        commands = np.stack([config.commands(u) for u in asked])
        states.append(plant.step(commands, Joints(stiffness[:, step], rest[:, step])))
        estimated.append(np.array([measurement.sum(config.weights) for measurement in measurements]))
        done(step, steps - 1)
    outputs = np.stack([state.outputs for state in states], axis=1)
    return Traces(
        target=target,
        command=np.stack(command, axis=1),
        outputs=outputs,
        true=(outputs * config.weights).sum(axis=2),
        estimated=np.stack(estimated, axis=1),
        converged=np.stack([state.converged for state in states], axis=1),
        logs=tuple(tuple(controller.log) for controller in controllers),
    )
