"""All episodes of one controller in closed loop, stepped side by side."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

from exosight.control.batch import BatchPlant, Joints, Plants
from exosight.control.guard import Measurement, Transition
from exosight.control.laws import Law
from exosight.control.loop import RATE
from exosight.control.paths import ControllerConfig
from exosight.control.stress.episodes import Episode
from exosight.control.stress.frames import FrameDelivery, Look
from exosight.control.stress.plants import with_friction_and_creep
from exosight.control.valve import Valve, Valves
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


Solve = Callable[[Sequence[Episode]], Plants]
"""The plants of episodes, at rest."""


def solved(episodes: Sequence[Episode]) -> BatchPlant:
    """Every episode's system with its friction and creep, as mechanics solves it."""
    return BatchPlant([with_friction_and_creep(e.system, e.friction, e.creep) for e in episodes])


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
    solve: Solve = solved,
) -> Traces:
    """Every episode with its own controller, all from rest.

    look     `camera_sensor(estimator)`, or `true_sensor` for true readings
    config   which sensor is controlled and which channel is driven; the others rest at 0
    done     called with (steps done, steps in all)
    solve    how plants are simulated

    Raises InputError for no episodes, episodes of several lengths, or another number of controllers.
    """
    run = EpisodeRun(episodes, config, solve=solve)
    if len(controllers) != len(episodes):
        raise InputError(
            f"episodes: expected each with a controller, got {len(episodes)} and {len(controllers)} "
            "controllers"
        )
    frames = FrameDelivery(episodes, look)
    for controller in controllers:
        controller.reset()
    estimated = [np.zeros(len(episodes))]
    for step in range(1, run.steps):
        measurements = frames.measurements(run.plant, step - 1)
        asked = [
            controller.step(float(goal), measurement)
            for controller, goal, measurement in zip(
                controllers, run.target[:, step], measurements, strict=True
            )
        ]
        run.apply(step, np.array(asked))
        run.keep(np.array(asked))
        estimated.append(np.array([measurement.sum(config.weights) for measurement in measurements]))
        done(step, run.steps - 1)
    return run.traces(np.stack(estimated, axis=1), [tuple(controller.log) for controller in controllers])


class EpisodeRun:
    """The plants of all episodes, and what is recorded of them.

    config   which sensor is controlled and which channel is driven; the others rest at 0
    valves   how late the plants' actuators answer; by default as the episodes have it
    solve    how plants are simulated

    Raises InputError for no episodes, or episodes of several lengths.
    """

    def __init__(
        self,
        episodes: Sequence[Episode],
        config: ControllerConfig,
        valves: Sequence[Valve] | None = None,
        solve: Solve = solved,
    ) -> None:
        lengths = {len(episode.target) for episode in episodes}
        if len(lengths) != 1:
            raise InputError(
                f"episodes: expected one or more of one length, got {len(episodes)} of {len(lengths)} lengths"
            )
        (self.steps,) = lengths
        self.plant, self._config = solve(episodes), config
        self._valves = Valves(
            [episode.valve for episode in episodes] if valves is None else valves,
            len(self.plant.schema.channels),
        )
        self.target = np.stack([episode.target for episode in episodes])
        self._stiffness = np.stack([episode.stiffness for episode in episodes])
        self._rest = np.stack([episode.rest for episode in episodes])
        self._command, self._states = [np.zeros(len(episodes))], [self.plant.state]
        self._step = 0

    def apply(
        self,
        step: int,
        u: Float[np.ndarray, " episodes"],
        users: Int[np.ndarray, " episodes"] | None = None,
    ) -> Float[np.ndarray, "episodes outputs"]:
        """Give every plant its command, with the users as they are in this step, or each as in another one
        (`users`); what is read then.

        A step takes its time once, however often a command is tried out in it.
        """
        own = (np.arange(len(u)), np.full(len(u), step) if users is None else users)
        joints = Joints(self._stiffness[own], self._rest[own])
        seconds, self._step = (step - self._step) / RATE, step
        return self.plant.step(self._valves.step(self._config.commands(u)), joints, seconds).outputs

    def keep(self, u: Float[np.ndarray, " episodes"]) -> None:
        """Take the plants as they are now as those of the step."""
        self._command.append(u)
        self._states.append(self.plant.state)

    def traces(
        self, estimated: Float[np.ndarray, "episodes steps"], logs: Sequence[tuple[Transition, ...]]
    ) -> Traces:
        """All that was recorded."""
        outputs = np.stack([state.outputs for state in self._states], axis=1)
        return Traces(
            target=self.target,
            command=np.stack(self._command, axis=1),
            outputs=outputs,
            true=(outputs * self._config.weights).sum(axis=2),
            estimated=estimated,
            converged=np.stack([state.converged for state in self._states], axis=1),
            logs=tuple(logs),
        )
