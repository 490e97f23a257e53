"""The closed loop on a simulated system: trials run, and written to a folder."""

import math
import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from pydantic import TypeAdapter

from exosight.app.console import progress, to_json
from exosight.control import (
    CONTROL_SHAPE,
    ControllerStudy,
    Measure,
    Proportional,
    Record,
    Trial,
    hold_and_release,
    run_trial,
    study,
)
from exosight.control.loop import RATE
from exosight.control.simulated import SimulatedPlant
from exosight.control.trials import STEP_SECONDS
from exosight.control.tuning import tune
from exosight.evaluation import Column, Table, figures
from exosight.evaluation.tables import Cell
from exosight.exosuit.published import NAME
from exosight.exosuit.shapes import shape_to_dict
from exosight.files import as_csv, write_new_file
from exosight.system.camera import Camera
from exosight.system.system import System

TRIALS = 6


def run_trials(system: System, measure: Measure) -> ControllerStudy:
    """The paper's constant targets and step responses on a fresh simulated plant, with a progress bar."""
    finished = 0
    with progress("closed loop", "trials") as update:
        update(0, TRIALS)

        def done(_: Trial) -> None:
            nonlocal finished
            finished += 1
            update(finished, TRIALS)

        return study(SimulatedPlant(system), measure, done)


def run_targets(
    system: System,
    measure: Measure,
    sensor: str | None,
    channel: str | None,
    targets: Sequence[float],
    gains: Sequence[float],
) -> list[Trial]:
    """Every target, held for 10 s and then released, with every gain; from rest, with a progress bar.

    targets  of the sensor [its unit]; if empty, half of its largest reading within the limits
    gains    K_P [the channel's unit per that of the sensor]; if empty, half of what the steepest part of the
             path asks for

    Raises InputError or ConvergenceError as `exosight.control.tuning.tune` where something is left empty.
    """
    if not (targets and gains):
        known = tune(system, sensor, channel)
        targets = targets or (known.default_target,)
        gains = gains or (known.default_gain,)
    plant = SimulatedPlant(system)
    found: list[Trial] = []
    with progress("closed loop", "trials") as update:
        update(0, len(targets) * len(gains))
        for target in targets:
            for gain in gains:
                law = Proportional(gain, system.schema.channel(channel))
                asked = hold_and_release(target, round(STEP_SECONDS * RATE))
                found.append(run_trial(plant, law, measure, asked, sensor, channel))
                update(len(found), len(targets) * len(gains))
    return found


def trials_of(found: ControllerStudy) -> list[Trial]:
    """The paper's six, in order."""
    return [*found.steady_states, *found.step_responses]


def write_trials(
    trials: ControllerStudy | Sequence[Trial], model: str | None, camera: Camera, folder: Path
) -> None:
    """Write time series (CSV), figures (SVG), and measures with what they were made with (results.json).

    model    the estimator's file; None: the loop was closed on true readings
    """
    each = trials_of(trials) if isinstance(trials, ControllerStudy) else list(trials)
    for trial in each:
        write_new_file(folder / f"{_name_of(trial)}.csv", _time_series(trial).encode())
    for name, figure in _drawings(each).items():
        write_new_file(folder / f"{name}.svg", figures.to_svg(figure))
    record = each[0].record
    config = {
        "system": record.schema.system,
        "sensor": record.sensor,
        "channel": record.channel,
        "model": model,
        "camera": TypeAdapter(Camera).dump_python(camera, mode="json"),
        **({"shape": shape_to_dict(CONTROL_SHAPE)} if record.schema.system == NAME else {}),
    }
    content = to_json({"config": config, "trials": summaries(each)})
    write_new_file(folder / "results.json", content.encode())


def _drawings(trials: Sequence[Trial]) -> dict[str, Figure]:
    """Constant targets in one figure, step responses in one for each target, a line a gain."""
    steady = [trial.record for trial in trials if not _released(trial.record)]
    drawings = {"steady_states": figures.steady_states(steady)} if steady else {}
    steps: dict[float, dict[float, Record]] = {}
    for trial in trials:
        if _released(trial.record):
            steps.setdefault(float(trial.record.target[0]), {})[trial.gain] = trial.record
    for target, by_gain in steps.items():
        name = "step_responses" if len(steps) == 1 else f"step_responses_{target:g}"
        drawings[name] = figures.step_responses(by_gain)
    return drawings


def summaries(trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """What was measured on each trial as plain values; None where something never happened."""
    return [
        {
            "name": _name_of(trial),
            "gain": trial.gain,
            "target": float(trial.record.target[0]),
            **{key: None if value != value else value for key, value in asdict(trial.response).items()},
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
    words = f"{record.target[0]:.2f} {record.controlled.unit}, K_P = {trial.gain:g}"
    settled = None if math.isnan(response.settling_steps) else int(response.settling_steps)
    return (
        *(f"{words}, released" if _released(record) else words, settled),
        *(response.overshoot, response.steady_state_error, response.release_time),
        *(response.largest_u, response.smallest_u),
    )


def _released(record: Record) -> bool:
    return bool(record.target[-1] == 0)


def _name_of(trial: Trial) -> str:
    record = trial.record
    kind = "step" if _released(record) else "constant"
    unit = re.sub(r"\W", "", record.controlled.unit)
    return f"{kind}_{record.target[0]:.2f}{unit}_gain_{trial.gain:g}"


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
