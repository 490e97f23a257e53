"""Episodes as recordings, which `exosight replay` and the lab take."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from exosight.control.adaptive import Adaptive
from exosight.control.frame_check import GuardConfig, Measurement
from exosight.control.guard import Guarded, Transition
from exosight.control.guarded import GuardedName, guarded_of
from exosight.control.paths import ControllerConfig
from exosight.control.realtime import STAGES, Step
from exosight.control.recording import Recorder
from exosight.control.stress.episodes import Episode
from exosight.control.stress.frames import Look
from exosight.control.stress.suite import Solve, run_episodes, solved


class _Kept:
    """A controller whose measurements and commands are kept."""

    def __init__(self, own: Guarded | Adaptive) -> None:
        self.own, self.steps = own, list[Step]()
        self.log: list[Transition] = own.log

    def reset(self) -> None:
        self.own.reset()
        self.log = self.own.log
        self.steps.clear()

    def step(self, target: float, measurement: Measurement) -> float:
        changes = len(self.own.log)
        u = self.own.step(target, measurement)
        self.steps.append(
            Step(
                time=len(self.steps) * self.own.config.period,
                target=target,
                measurement=measurement,
                true=None,
                command=u,
                state=self.own.state,
                cause=", ".join(change.cause for change in self.own.log[changes:]),
                seconds=np.zeros(len(STAGES)),
                late=0.0,
                shown=measurement.commands,
            )
        )
        return u


def record_episodes(
    episodes: Sequence[Episode],
    paths: Sequence[Path],
    name: GuardedName,
    look: Look,
    config: ControllerConfig,
    model: Path,
    guard: GuardConfig,
    solve: Solve = solved,
) -> None:
    """Run episodes and write each to a new file, with pictures, estimates, true readings and states.

    A row is a step: what the controller got, what it asked for, and what was true when the step began. The
    times of its stages are 0. Where a frame was repeated, the estimate is that of the first time.

    paths   of the files, one an episode
    name    of the controller
    look    `camera_sensor` of the network whose file is `model`
    guard   settings of the guard

    Raises InputError as `run_episodes`, DataError if a file exists or cannot be written.
    """
    kept = [_Kept(guarded_of(name, config, guard)) for _ in episodes]
    traces = run_episodes(episodes, kept, look, config, solve=solve)
    for path, controller, true in zip(paths, kept, traces.outputs, strict=True):
        _write(path, controller, true, model)


def _write(path: Path, kept: _Kept, true: Float[np.ndarray, "steps outputs"], model: Path) -> None:
    images = (step.measurement.image for step in kept.steps)
    shape = next((image.shape for image in images if image is not None), (1, 1))
    recorder = Recorder(path, shape, kept.own, model)
    try:
        for step, outputs in zip(kept.steps, true[:-1], strict=True):
            recorder.append(replace(step, true=outputs))
    finally:
        recorder.close()
