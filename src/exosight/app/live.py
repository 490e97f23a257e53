"""The loop in real time as a command: its parts and its log."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from exosight.app.console import say
from exosight.app.stopping import PATIENCE, STOP
from exosight.control.actuator_curve import ActuatorCurve
from exosight.control.actuators import Actuator, Lines, NoActuator
from exosight.control.adaptive import Adaptive
from exosight.control.estimator import OnnxEstimator
from exosight.control.guard import GuardConfig, Guarded, State
from exosight.control.guarded import GuardedName, guarded_of
from exosight.control.paths import ControllerConfig
from exosight.control.realtime import Step, run_live, timings
from exosight.control.recording import Recorder
from exosight.control.simulated import SimulatedPlant
from exosight.control.simulated_device import SimulatedDevice
from exosight.control.sources import FrameStream, open_source
from exosight.control.views import Views, cameras_of, joined, stacked_size
from exosight.errors import InputError
from exosight.evaluation.tables import Column, Table
from exosight.system.schema import Channel
from exosight.system.system import System
from exosight.vision.pictures import CameraCrop, Crop

WORDS = {State.SLOW: "loads slowly", State.HOLD: "holds", State.RELEASE: "releases"}
"""What the controller does in each state but the normal one."""


class Log:
    """What happened: one line a second and one for every change of the guard's state; numbers for the end.

    say      where the lines go
    config   of the controller: what is controlled and driven
    """

    def __init__(self, say: Callable[[str], None], config: ControllerConfig) -> None:
        self._config, self._say, self._seconds, self._late = config, say, [], []
        self._rows: list[tuple[float, ...]] = []
        self._missed = 0
        self.missed_at_end = 0  # periods, see `run_live`
        self._told, self._told_missed, self._told_remedy = -1, 0, ""
        self._changes: list[dict[str, Any]] = []

    def append(self, step: Step) -> None:
        """Take note of a step."""
        self._seconds.append(step.seconds)
        self._late.append(step.late)
        weights, read = self._config.weights, step.measurement.sum(self._config.weights)
        true = np.nan if step.true is None else float(step.true @ weights)
        self._rows.append((step.time, step.target, read, true, step.command))
        self._missed += step.missed
        if step.cause:
            remedy = step.problem.remedy if step.problem else ""
            change = {"time_s": step.time, "state": step.state.value, "cause": step.cause, "remedy": remedy}
            self._changes.append(change)
            self._say(f"{step.time:7.1f} s  {self._changed(step)}")
        self._say_remedy(step)
        if int(step.time) > self._told:
            self._told = int(step.time)
            self._say(f"{step.time:7.1f} s  {self._state(step)}{self._newly_missed()}")

    def _say_remedy(self, step: Step) -> None:
        """What would help, once for each kind of problem that restrains the controller."""
        if step.problem is None or step.state is State.NORMAL or step.problem.remedy == self._told_remedy:
            return
        self._told_remedy = step.problem.remedy
        self._say(f"           {step.problem.cause}: {step.problem.remedy}")

    def _changed(self, step: Step) -> str:
        """In words, a change of the guard's state."""
        return f"{step.state.value}: {step.cause}"

    def _state(self, step: Step) -> str:
        """In words, what is measured and done."""
        sensor, driven = self._config.controlled, self._config.driven
        value = step.measurement.sum(self._config.weights)
        words = [
            "no estimate" if np.isnan(value) else f"{sensor.name} {value:.3f} {sensor.unit}",
            f"target {step.target:g} {sensor.unit}",
            f"{driven.name} {step.command:.2f} {driven.unit}",
        ]
        if step.state in WORDS:
            why = step.problem.cause if step.problem else "until enough frames in a row were good"
            words.append(f"{WORDS[step.state]}: {why}")
        return ", ".join(words)

    def _newly_missed(self) -> str:
        new, self._told_missed = self.missed - self._told_missed, self.missed
        return f"; missed periods: {new}" if new else ""

    @property
    def missed(self) -> int:
        """Periods without a step."""
        return self._missed + self.missed_at_end

    @property
    def steps(self) -> int:
        """How many there were."""
        return len(self._seconds)

    @property
    def seconds(self) -> np.ndarray:
        """Of the stages, (steps, 4) [s]."""
        return np.array(self._seconds)

    @property
    def late(self) -> np.ndarray:
        """How late each step began, (steps,) [s]."""
        return np.array(self._late)

    def run(self) -> dict[str, np.ndarray]:
        """Time [s], target, estimated, true and command of each step, (steps,) by name; NaN: unknown."""
        return dict(
            zip(("time", "target", "estimated", "true", "command"), np.array(self._rows).T, strict=True)
        )

    def end(self) -> str:
        """How the run ended, and whether it kept the clock."""
        driven = self._config.driven
        return self._on_time(f"{driven.name} is back at 0 {driven.unit} after {self.steps} steps")

    def _on_time(self, words: str) -> str:
        period = f"{1e3 * self._config.period:g} ms"
        if not self.missed:
            return f"{words}, one in each period of {period}"
        took, longest = 1e3 * np.quantile(self.seconds.sum(axis=1), [0.5, 1.0])
        return (
            f"{words}; {self.missed} of {self.steps + self.missed} periods of {period} were missed, as steps "
            f"took {took:.0f} ms (median), {longest:.0f} ms at most: choose a smaller --rate, or end other "
            "programs"
        )

    def summary(self) -> dict[str, Any]:
        """Timing, missed periods and changes of state as plain values."""
        return {
            "steps": self.steps,
            "missed_periods": self.missed,
            "period_s": self._config.period,
            "timing": [asdict(timing) for timing in timings(self.seconds)],
            "late_p99_s": float(np.quantile(self.late, 0.99)),
            "guard": self._changes,
        }


def timing_table(seconds: np.ndarray, late: np.ndarray) -> Table:
    """How long the stages of a step took.

    seconds   (steps, 4)   [s]
    late      (steps,)     how long after its time each step began [s]
    """
    columns = (Column("stage"), *(Column(name, "ms", digits=2) for name in ("median", "p99", "largest")))
    rows = [(t.stage, 1e3 * t.p50, 1e3 * t.p99, 1e3 * t.largest) for t in timings(seconds)]
    p50, p99, largest = (1e3 * np.quantile(late, [0.5, 0.99, 1.0])).tolist()
    rows.append(("late by", p50, p99, largest))
    note = "see: a frame, or rendering; act: the actuator, or solving; late: behind the clock when it began"
    return Table("timing", f"{len(seconds)} steps", columns, tuple(rows), note)


@dataclass(frozen=True)
class LiveRun:
    """What a run in real time is made of.

    system      that is simulated, or stands for the one before the camera; None: it is only observed
    network     that reads the images, and its file; of several cameras one each
    config      what the controller knows of the system
    target      of each period [the controlled sensor's unit]
    record      new file for all that is seen, estimated and done, if there is to be one
    controller  its name
    """

    system: System | None
    network: OnnxEstimator | Views
    model: tuple[Path, ...]
    config: ControllerConfig
    target: Sequence[float]
    record: Path | None = None
    controller: GuardedName = "guarded"


def on_simulation(run: LiveRun, log: Log) -> None:
    """Look at the simulated system, and actuate it."""
    assert run.system is not None
    guarded = guarded_of(run.controller, run.config)
    views = run.network.cameras if isinstance(run.network, Views) else ()
    device = SimulatedDevice(SimulatedPlant(run.system, run.config.period, views), run.config)
    with written(run, guarded, log) as done, _lets_go(run.config):
        log.missed_at_end = run_live(device, run.network, guarded, device, run.target, done)


@contextmanager
def opened(
    source: Sequence[str], network: OnnxEstimator | Views, crop: Crop | None, period: float
) -> Iterator[tuple[FrameStream, bool] | None]:
    """The frames of a source, or of one for each view, one of which has been read; whether cameras give them.

    period   of the loop [s]
    """
    if not source:
        yield None
        return
    networks = cameras_of(network)
    if len(source) != len(networks):
        raise InputError(
            f"live: expected one source for each network, got {len(source)} and {len(networks)}; name as "
            "many with --source as with --model"
        )
    if crop is not None and len(source) > 1:
        raise InputError("--crop: expected one source with it, got several; crop their pictures beforehand")
    from_camera = all(name.isdecimal() for name in source)
    with ExitStack() as stack:
        frames = [
            stack.enter_context(closing(_open(name, own, crop or own.crop)))
            for name, own in zip(source, networks, strict=True)
        ]
        if isinstance(network, Views):
            frozen = frozen_frames(from_camera, period)
            yield stack.enter_context(closing(joined(frames, network.sizes, frozen))), from_camera
        else:
            yield frames[0], from_camera


def _open(name: str, network: OnnxEstimator, crop: Crop | CameraCrop | None) -> FrameStream:
    height, width = network.card.schema.image_size
    return open_source(name, width, height, crop, lambda fault: say(f"not read: {fault}"))


def on_source(
    run: LiveRun,
    source: tuple[FrameStream, bool],
    send: str | None,
    log: Log,
    curve: ActuatorCurve | None = None,
) -> None:
    """Look through a camera or at pictures in files, and write the command to whoever reads it at `send`.

    source   as `opened` gives it
    curve    of the actuator there; None: it takes the command in the unit of its channel
    """
    frames, from_camera = source
    frozen = frozen_frames(from_camera, run.config.period)
    guarded = guarded_of(run.controller, run.config, GuardConfig(frozen_frames=frozen))
    with ExitStack() as stack:
        done = stack.enter_context(written(run, guarded, log))
        stack.enter_context(_lets_go(run.config))
        actuator = stack.enter_context(closing(_sender(send, run.config.driven, curve)))
        log.missed_at_end = run_live(frames, run.network, guarded, actuator, run.target, done)


def _sender(send: str | None, driven: Channel, curve: ActuatorCurve | None) -> Actuator:
    if send is None:
        return NoActuator()
    if curve is None:
        return Lines.open(send, driven.name, driven.unit)
    return Lines.open(send, curve.name, curve.unit, curve.at)


def frozen_frames(from_camera: bool, period: float) -> int:
    """Same frames in a row that are frozen whatever u does, see `GuardConfig`.

    A camera has noise: the same picture, bit by bit, for half a second is no picture.
    """
    return max(2, round(0.5 / period)) if from_camera else 0


@contextmanager
def written(run: LiveRun, guarded: Guarded | Adaptive, log: Log) -> Iterator[Callable[[Step], None]]:
    """What to do with every step: log it, and record it if there is a file for it."""
    with ExitStack() as stack:
        recorder = None
        if run.record is not None:
            shape = stacked_size([each.card.schema.image_size for each in cameras_of(run.network)])
            recorder = stack.enter_context(closing(Recorder(run.record, shape, guarded, *run.model)))

        def done(step: Step) -> None:
            log.append(step)
            if recorder is not None:
                recorder.append(step)
            STOP.check()  # where the exception was lost

        yield done


@contextmanager
def _lets_go(config: ControllerConfig) -> Iterator[None]:
    """A loop that is stopped first lets u return to 0, which takes its time."""
    ramp = float(np.abs(config.loading.u).max()) / config.rate + 2 * config.period
    STOP.patience = ramp + PATIENCE
    try:
        yield
    finally:
        STOP.patience = PATIENCE
