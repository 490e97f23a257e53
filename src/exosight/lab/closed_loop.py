"""Runs of the closed loop, told step by step while they are worked out."""

import base64
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from threading import Lock
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from exosight.control import (
    ControllerConfig,
    Guarded,
    Measurement,
    Observation,
    Proportional,
    Scheduled,
    hold,
    run,
    run_guarded,
    true_measurement,
)
from exosight.control.loop import RATE
from exosight.control.simulated import SimulatedPlant
from exosight.control.tuning import tune
from exosight.exosuit.assembly import Exosuit, Pose, assemble, observe
from exosight.lab.settings import Disturbance, LoopSettings
from exosight.lab.views import (
    CAMERA,
    exosuit_of,
    network,
    photograph,
    png_of,
    reading_of,
    scene_of,
)
from exosight.mechanics import stack
from exosight.vision.corruptions import corrupt
from exosight.vision.ood_images import draw_ood_images

HELD = 40
"""Steps for which the target is held; then it is 0 N for RELEASED steps."""
RELEASED = 20
_WRONG = range(20, 30)  # steps in which pictures are disturbed
_SOFTER = 0.8

Step = dict[str, Any]


class Stopped(Exception):
    """Nobody listens any more."""


def run_trial(settings: LoopSettings, tell: Callable[[Step], None]) -> None:
    """Run the loop and tell of every step as soon as it is known.

    tell   called with each step as JSON values; whatever it raises ends the run

    Raises InputError or ConvergenceError if the exosuit cannot be driven so.
    """
    exosuit = exosuit_of(settings.view)
    target = np.concatenate([hold(settings.target, HELD), hold(0.0, RELEASED)])
    guarded = Guarded(Scheduled(_tuned(exosuit))) if settings.law == "scheduled" else None
    real = replace(exosuit, young=_SOFTER * exosuit.young) if settings.disturbance == "softer" else exosuit
    plant = SimulatedPlant(real, CAMERA)
    eye = _Eye(settings, real, target, tell, guarded)
    if guarded is not None:
        run_guarded(plant, guarded, eye.look, target)
    else:
        run(plant, Proportional(settings.gain), eye.measure, target)


_tuning = Lock()


@lru_cache(maxsize=32)
def _known(exosuit: Exosuit) -> ControllerConfig:
    return tune(exosuit)


def _tuned(exosuit: Exosuit) -> ControllerConfig:
    with _tuning:  # two runs of one exosuit: the second finds what the first has solved
        return _known(exosuit)


class _Eye:
    """Looks at the plant through the view's camera, lets go wrong what is to go wrong, and tells."""

    def __init__(
        self,
        settings: LoopSettings,
        exosuit: Exosuit,
        target: np.ndarray,
        tell: Callable[[Step], None],
        guarded: Guarded | None,
    ) -> None:
        self._settings, self._exosuit, self._target, self._tell, self._guarded = (
            settings,
            exosuit,
            target,
            tell,
            guarded,
        )
        self._robot = stack([assemble(exosuit)])
        self._step = 0
        self._last = Measurement()

    def measure(self, observation: Observation) -> float:
        """F_net for a law without a guard; NaN where there is none."""
        return self.look(observation).net_force

    def look(self, observation: Observation) -> Measurement:
        """What is known of the plant in this step."""
        seen = replace(
            observation, image=photograph(self._settings.view, observation.image[None], self._step)[0]
        )
        measurement = self._disturbed(seen)
        self._last = measurement
        pose: Pose = jax.tree.map(
            lambda leaf: np.asarray(leaf)[0, 0], observe(self._robot, jnp.asarray(observation.q)[None, None])
        )
        self._tell(
            {
                "time": self._step / RATE,
                "target": float(self._target[self._step]),
                "u": round(observation.u, 4),
                "F_net": round(observation.net_force, 5),
                "true": [round(float(force), 5) for force in observation.forces],
                "reading": None if measurement.reading is None else reading_of(measurement.reading),
                "image": None
                if measurement.image is None
                else base64.b64encode(png_of(measurement.image)).decode(),
                "guard": self._guard(),
                "scene": scene_of(self._exosuit, pose),
                "converged": observation.converged,
            }
        )
        self._step += 1
        return measurement

    def _guard(self) -> dict[str, str] | None:
        """The guard's state while the u of this step was chosen, and why it last changed."""
        if self._guarded is None:
            return None
        log = self._guarded.log
        return {"state": self._guarded.state.value, "cause": log[-1].cause if log else "start"}

    def _measurement(self, observation: Observation) -> Measurement:
        if self._settings.sensor == "true":
            return true_measurement(observation)
        return Measurement(observation.image, network().read(observation.image[None]), u=observation.u)

    def _disturbed(self, observation: Observation) -> Measurement:
        wrong: Disturbance = self._settings.disturbance if self._step in _WRONG else "none"
        if wrong == "lost":
            return Measurement(u=observation.u)
        if wrong == "frozen":
            return replace(self._last, u=observation.u)
        if wrong == "noise":
            image = corrupt(observation.image[None], "noise-high", seed=1, first=self._step)[0]
            return self._measurement(replace(observation, image=image))
        if wrong == "elsewhere":
            return self._measurement(
                replace(observation, image=draw_ood_images("room", 1, seed=self._step)[0])
            )
        return self._measurement(observation)
