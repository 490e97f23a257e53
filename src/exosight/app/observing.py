"""A run in real time of a system that is only observed: pictures in, estimates out, nothing driven."""

from contextlib import ExitStack
from typing import Any

from exosight.app.live import LiveRun, Log, frozen_frames, written
from exosight.control.actuators import NoActuator
from exosight.control.at_rest import observer
from exosight.control.estimator import Reading, shown_score
from exosight.control.guard import State
from exosight.control.realtime import Step, run_live
from exosight.control.sources import FrameStream
from exosight.errors import InputError

WORDS = {
    State.NORMAL: "trusted",
    State.SLOW: "uncertain",
    State.HOLD: "not trusted",
    State.RELEASE: "not trusted",
}
"""What each of the guard's states says of the estimates."""


class ObservationLog(Log):
    """What was read: one line a second and one for every change of trust, and all estimates for the end."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.readings: list[Reading] = []
        self._read_at: list[float] = []

    def append(self, step: Step) -> None:
        """Take note of a step."""
        super().append(step)
        if step.measurement.reading is not None:
            self.readings.append(step.measurement.reading)
            self._read_at.append(step.time)

    def _changed(self, step: Step) -> str:
        return f"{WORDS[step.state]}: {step.cause}"

    def _state(self, step: Step) -> str:
        reading = step.measurement.reading
        if reading is None:
            return f"no estimate: {step.problem.cause if step.problem else 'no picture'}"
        words = [
            f"{spec.name} {value:.3g} ({low:.3g} to {high:.3g}) {spec.unit}"
            for spec, value, low, high in zip(
                self._config.schema.estimated, reading.forces[0], reading.low[0], reading.high[0], strict=True
            )
        ]
        if reading.error_probability is not None:
            words.append(f"probability of a large error {100 * reading.error_probability[0]:.0f} %")
        if step.state is not State.NORMAL:
            words.append(f"{WORDS[step.state]}: {step.problem.cause if step.problem else 'until now'}")
        return ", ".join(words)

    def end(self) -> str:
        """How many pictures there were, and whether the clock was kept."""
        return self._on_time(f"{len(self.readings)} pictures were read in {self.steps} steps")

    def summary(self) -> dict[str, Any]:
        """Timing, changes of trust and every estimate as plain values."""
        schema = self._config.schema
        return {
            **super().summary(),
            "sensors": {spec.name: spec.unit for spec in schema.estimated},
            "estimates": [
                {
                    "time_s": time,
                    **{
                        name: values[0].tolist()
                        for name, values in zip(
                            ("value", "low", "high"), (reading.forces, reading.low, reading.high), strict=True
                        )
                    },
                    "ood_score": shown_score(reading.ood_score[0]),
                    "error_probability": None
                    if reading.error_probability is None
                    else round(float(reading.error_probability[0]), 4),
                }
                for time, reading in zip(self._read_at, self.readings, strict=True)
            ],
        }


def observe(run: LiveRun, source: tuple[FrameStream, bool], log: Log) -> None:
    """Read the pictures of a source until it ends or the time is over.

    source   as `exosight.app.live.opened` gives it
    """
    frames, from_camera = source
    guarded = observer(run.config.schema, run.config.period, frozen_frames(from_camera, run.config.period))
    with ExitStack() as stack:
        done = stack.enter_context(written(run, guarded, log))
        log.missed_at_end = run_live(frames, run.network, guarded, NoActuator(), run.target, done)


def refuse_control(system: str | None, given: dict[str, object]) -> None:
    """Raise InputError if options ask for what only a controlled system has.

    system   of the network
    given    options by name, with their values; None or False: not given
    """
    for name, value in given.items():
        if value not in (None, False):
            raise InputError(
                f"live: --{name} is for a system that is simulated as well, and of {system} only pictures "
                "and readings are known; leave it out, and it is observed"
            )
