"""The closed loop on a simulated system: trials run, and written to a folder."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from exosight.app.console import progress, to_json
from exosight.app.control_figures import trial_figures
from exosight.control import (
    CONTROL_SHAPE,
    GuardConfig,
    Measure,
    Sense,
    Trial,
    guarded_of,
    hold_and_release,
    run_guarded_trials,
    run_trials,
)
from exosight.control.guarded import GuardedName
from exosight.control.loop import RATE
from exosight.control.plant import Plant
from exosight.control.policy_file import LearnedPolicy
from exosight.control.simulated import SimulatedPlant
from exosight.control.trials import STEP_SECONDS, Asked
from exosight.control.tuning import tune
from exosight.control.valve import AT_ONCE, Valve, ValvePlant
from exosight.evaluation import Column, Table
from exosight.evaluation.figures import to_bytes
from exosight.evaluation.tables import Cell
from exosight.exosuit.published import NAME
from exosight.exosuit.shapes import shape_to_dict
from exosight.files import as_csv, write_new_file
from exosight.system.camera import Camera
from exosight.system.system import System


def run_with_progress(
    system: System,
    measure: Measure,
    asked: Sequence[Asked],
    sensor: str | None = None,
    channel: str | None = None,
    valve: Valve = AT_ONCE,
) -> list[Trial]:
    """`exosight.control.run_trials` on a simulated plant behind a valve, with a progress bar."""
    return _counted(run_trials(_plant(system, valve), measure, asked, sensor, channel), len(asked))


def run_guarded_with_progress(
    system: System,
    name: GuardedName | LearnedPolicy,
    sense: Sense,
    asked: Sequence[Asked],
    sensor: str | None = None,
    channel: str | None = None,
    valve: Valve = AT_ONCE,
) -> list[Trial]:
    """The targets alone of what is asked, each once, with a controller that is tuned on the system first.

    Raises InputError or ConvergenceError as `exosight.control.tuning.tune`.
    """
    guard = GuardConfig(response_time=valve.response_time)
    guarded = guarded_of(name, tune(system, sensor, channel), guard)
    targets = list({tuple(target): target for _, target in asked}.values())
    return _counted(run_guarded_trials(_plant(system, valve), guarded, sense, targets), len(targets))


def _plant(system: System, valve: Valve) -> Plant:
    plant = SimulatedPlant(system)
    return plant if valve == AT_ONCE else ValvePlant(plant, valve)


def _counted(trials: Iterator[Trial], count: int) -> list[Trial]:
    found: list[Trial] = []
    with progress("closed loop", "trials") as update:
        update(0, count)
        for trial in trials:
            found.append(trial)
            update(len(found), count)
    return found


def held_and_released(
    system: System,
    sensor: str | None,
    channel: str | None,
    targets: Sequence[float],
    gains: Sequence[float],
) -> list[Asked]:
    """Every target, held for 10 s and then released, with every gain.

    targets  of the sensor [its unit]; if empty, half of its largest reading within the limits
    gains    K_P [the channel's unit per that of the sensor]; if empty, half of what the steepest part of the
             path asks for

    Raises InputError or ConvergenceError as `exosight.control.tuning.tune` where something is left empty.
    """
    if not (targets and gains):
        known = tune(system, sensor, channel)
        targets = targets or (known.default_target,)
        gains = gains or (known.default_gain,)
    steps = round(STEP_SECONDS * RATE)
    return [(gain, hold_and_release(target, steps)) for target in targets for gain in gains]


def write_trials(
    trials: Sequence[Trial],
    model: str | None,
    camera: Camera,
    folder: Path,
    controller: str = "proportional",
) -> None:
    """Write time series (CSV), figures (SVG), and measures with what they were made with (results.json).

    model       the estimator's file; None: the loop was closed on true readings
    controller  its name
    """
    for trial in trials:
        write_new_file(folder / f"{_name_of(trial)}.csv", _time_series(trial).encode())
    for name, figure in trial_figures(trials).items():
        write_new_file(folder / f"{name}.svg", to_bytes(figure))
    record = trials[0].record
    config = {
        "system": record.schema.system,
        "sensor": record.sensor,
        "channel": record.channel,
        "controller": controller,
        "model": model,
        "camera": TypeAdapter(Camera).dump_python(camera, mode="json"),
        **({"shape": shape_to_dict(CONTROL_SHAPE)} if record.schema.system == NAME else {}),
    }
    content = to_json({"config": config, "trials": summaries(trials)})
    write_new_file(folder / "results.json", content.encode())


def summaries(trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """What was measured on each trial as plain values; None where something never happened."""
    return [
        {
            "name": _name_of(trial),
            "target": float(trial.record.target[0]),
            **{
                key: None if value != value else value
                for key, value in {"gain": trial.gain, **asdict(trial.response)}.items()
            },
        }
        for trial in trials
    ]


def trials_table(trials: Sequence[Trial]) -> Table:
    """What was measured on each trial, for the terminal."""
    record = trials[0].record
    sensor, channel = record.controlled, record.driven
    columns = (
        Column("trial"),
        Column("steps to settle"),
        Column("overshoot", sensor.unit, digits=3),
        Column("steady error", sensor.unit, digits=3),
        Column("time to release", "s", digits=1),
        Column(f"largest {channel.name}", channel.unit, digits=2),
        Column(f"smallest {channel.name}", channel.unit, digits=2),
    )
    note = (
        f"Measured on the true {sensor.name}; a dash: it never settled within 5 % of the target, or was not "
        "released"
    )
    return Table("trials", "Closed loop", columns, tuple(_row(trial) for trial in trials), note)


def _row(trial: Trial) -> tuple[Cell, ...]:
    response, record = trial.response, trial.record
    words = [f"{record.target[0]:.2f} {record.controlled.unit}"]
    words += [trial.law] * bool(trial.law) + ["released"] * trial.released
    return (
        *(", ".join(words), trial.settling_steps),
        *(response.overshoot, response.steady_state_error, response.release_time),
        *(response.largest_u, response.smallest_u),
    )


def _name_of(trial: Trial) -> str:
    record = trial.record
    kind = "step" if trial.released else "constant"
    unit = re.sub(r"\W", "", record.controlled.unit)
    gain = f"_gain_{trial.gain:g}" if trial.law else ""
    return f"{kind}_{record.target[0]:.2f}{unit}{gain}"


def _time_series(trial: Trial) -> str:
    """A trial as CSV, a row a step."""
    record = trial.record
    name, unit, driven = record.sensor, record.controlled.unit, record.driven
    heads = (
        *("time [s]", f"target [{unit}]", f"{name} true [{unit}]", f"{name} measured [{unit}]"),
        *(f"{driven.name} [{driven.unit}]", "converged"),
    )
    columns = (record.time, record.target, record.true, record.estimated, record.command)
    rows = zip(
        *(np.asarray(column).tolist() for column in columns), record.converged.astype(int), strict=True
    )
    return as_csv(heads, rows, digits=9)
