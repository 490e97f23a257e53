"""Runs of the closed loop, reported step by step while they are worked out."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from threading import Lock
from typing import Any

import equinox as eqx
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
from exosight.lab.designs import key_of
from exosight.lab.estimates import reading_of
from exosight.lab.pictures import camera_image, png_text
from exosight.lab.settings import Disturbance, LoopSettings
from exosight.lab.system import LabSystem
from exosight.lab.views import observe_one, scene_of
from exosight.mechanics import Rod
from exosight.system.system import System, stack_systems
from exosight.vision.corruptions import corrupt
from exosight.vision.ood_images import draw_ood_images
from exosight.vision.pictures import resized

HELD = 40
"""Steps for which the target is held; then it is 0 for RELEASED steps."""
RELEASED = 20
_WRONG = range(20, 30)  # steps in which pictures are disturbed
_SOFTER = 0.8
_TUNED = 32  # controllers that are remembered

Step = dict[str, Any]


class Stopped(Exception):
    """Nobody listens any more."""


def run_trial(settings: LoopSettings, lab: LabSystem, report: Callable[[Step], None]) -> None:
    """Run the loop and report every step as soon as it is known.

    report  called with each step as JSON values; whatever it raises ends the run

    Raises InputError or ConvergenceError if the system cannot be driven so.
    """
    system = lab.cached(settings.view).system
    channel = lab.schema.channels[lab.channel(settings.channel)]
    settings = replace(settings, sensor=lab.sensor(settings.sensor).name, channel=channel.name)
    target = np.concatenate([hold(settings.target, HELD), hold(0.0, RELEASED)])
    guarded = None
    if settings.law == "scheduled":
        guarded = Guarded(Scheduled(_tuned(lab, settings, system)))
    real = softer(system) if settings.disturbance == "softer" else system
    sensor = _TrialSensor(settings, lab, real, target, report, guarded)
    plant = SimulatedPlant(real)
    if guarded is not None:
        run_guarded(plant, guarded, sensor.measure, target)
    else:
        law = Proportional(settings.gain, channel)
        run(plant, law, sensor.value, target, settings.sensor, settings.channel)


def softer(system: System) -> System:
    """The system with rods of 80 % of their modulus; links and joints stay."""
    bodies = tuple(
        eqx.tree_at(lambda rod: rod.young, body, _SOFTER * np.asarray(body.young))
        if isinstance(body, Rod)
        else body
        for body in system.bodies
    )
    return eqx.tree_at(lambda whole: whole.bodies, system, bodies)


_tuning = Lock()
_known: OrderedDict[tuple[str, ...], ControllerConfig] = OrderedDict()


def _tuned(lab: LabSystem, settings: LoopSettings, system: System) -> ControllerConfig:
    design = key_of(lab.controls.complete(settings.view.design))
    key = (lab.name, design, str(settings.sensor), str(settings.channel))
    with _tuning:  # two runs of one system: the second finds what the first has solved
        if key not in _known:
            _known[key] = tune(system, settings.sensor, settings.channel)
            while len(_known) > _TUNED:
                _known.popitem(last=False)
        _known.move_to_end(key)
        return _known[key]


class _TrialSensor:
    """Measures the plant through the view's camera with the disturbance asked for, and reports each step."""

    def __init__(
        self,
        settings: LoopSettings,
        lab: LabSystem,
        system: System,
        target: np.ndarray,
        report: Callable[[Step], None],
        guarded: Guarded | None,
    ) -> None:
        self._settings, self._lab, self._system = settings, lab, system
        self._target, self._report, self._guarded = target, report, guarded
        self._stacked = stack_systems([system])
        self._weights = lab.schema.weights(str(settings.sensor))
        self._channel = lab.channel(settings.channel)
        self._step = 0
        self._last = Measurement()

    def value(self, observation: Observation) -> float:
        """The controlled sensor for a law without a guard; NaN where there is no estimate."""
        return self.measure(observation).sum(self._weights)

    def measure(self, observation: Observation) -> Measurement:
        """Measure the plant, and report the step."""
        image = camera_image(self._settings.view.camera, observation.image[None], self._step)[0]
        measurement = self._disturbed(replace(observation, image=image))
        self._last = measurement
        reading = measurement.reading
        self._report(
            {
                "time": self._step / RATE,
                "target": float(self._target[self._step]),
                "command": round(float(observation.commands[self._channel]), 4),
                "readings": {
                    sensor.name: round(float(value), 5)
                    for sensor, value in zip(self._lab.schema.sensors, observation.readings, strict=True)
                },
                "reading": None if reading is None else reading_of(reading, self._lab.schema),
                "image": None if measurement.image is None else png_text(measurement.image),
                "guard": self._guard(),
                "scene": scene_of(
                    self._system, observe_one(self._stacked, observation.q, observation.history)
                ),
                "converged": observation.converged,
            }
        )
        self._step += 1
        return measurement

    def _guard(self) -> dict[str, str] | None:
        """The guard's state while the command of this step was chosen, and why it last changed."""
        if self._guarded is None:
            return None
        log = self._guarded.log
        return {"state": self._guarded.state.value, "cause": log[-1].cause if log else "start"}

    def _measurement(self, observation: Observation) -> Measurement:
        if self._settings.measured == "true":
            return true_measurement(observation)
        reading = self._lab.network.read(observation.image[None])
        return Measurement(observation.image, reading, commands=observation.commands)

    def _disturbed(self, observation: Observation) -> Measurement:
        wrong: Disturbance = self._settings.disturbance if self._step in _WRONG else "none"
        commands = observation.commands
        if wrong == "lost":
            return Measurement(commands=commands)
        if wrong == "frozen":
            return replace(self._last, commands=commands)
        if wrong == "noise":
            image = corrupt(observation.image[None], "noise-high", seed=1, first=self._step)[0]
            return self._measurement(replace(observation, image=image))
        if wrong == "elsewhere":
            return self._measurement(replace(observation, image=self._elsewhere()))
        return self._measurement(observation)

    def _elsewhere(self) -> np.ndarray:
        """A picture of something else, in the camera's size."""
        camera = self._lab.schema.cameras[0]
        return resized(draw_ood_images("room", 1, seed=self._step)[0], camera.width, camera.height)
