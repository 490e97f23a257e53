"""The closed loop on a simulated exosuit: the paper's six trials run, and written to a folder."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from exosight.app.console import progress, to_json
from exosight.control import CONTROL_SHAPE, ControllerStudy, Measure, Trial, study
from exosight.control.simulated import SimulatedPlant
from exosight.evaluation import Column, Table, figures
from exosight.evaluation.tables import Cell
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import published
from exosight.exosuit.shapes import shape_to_dict
from exosight.files import as_csv, write_new_file
from exosight.system.camera import Camera

TRIALS = 6


def run_trials(exosuit: Exosuit, camera: Camera, measure: Measure) -> ControllerStudy:
    """Constant targets and step responses on a fresh simulated plant, with a progress bar."""
    finished = 0
    with progress("closed loop", "trials") as update:
        update(0, TRIALS)

        def done(_: Trial) -> None:
            nonlocal finished
            finished += 1
            update(finished, TRIALS)

        return study(SimulatedPlant(published(exosuit, camera)), measure, done)


def write_trials(trials: ControllerStudy, model: str | None, camera: Camera, folder: Path) -> None:
    """Write time series (CSV), figures (SVG), and measures with what they were made with (results.json).

    model    the estimator's file; None: the loop was closed on the true force
    """
    for trial in _all(trials):
        write_new_file(folder / f"{_name_of(trial)}.csv", _time_series(trial).encode())
    drawings = {
        "steady_states": figures.steady_states([trial.record for trial in trials.steady_states]),
        "step_responses": figures.step_responses({t.gain: t.record for t in trials.step_responses}),
    }
    for name, figure in drawings.items():
        write_new_file(folder / f"{name}.svg", figures.to_svg(figure))
    config = {
        "model": model,
        "camera": TypeAdapter(Camera).dump_python(camera, mode="json"),
        "shape": shape_to_dict(CONTROL_SHAPE),
    }
    content = to_json({"config": config, "trials": summaries(trials)})
    write_new_file(folder / "results.json", content.encode())


def summaries(trials: ControllerStudy) -> list[dict[str, Any]]:
    """What was measured on each trial as plain values; None where something never happened."""
    return [
        {
            "name": _name_of(trial),
            "gain": trial.gain,
            "target": float(trial.record.target[0]),
            **{key: None if value != value else value for key, value in asdict(trial.response).items()},
        }
        for trial in _all(trials)
    ]


def trials_table(trials: ControllerStudy) -> Table:
    """What was measured on each trial, for the terminal."""
    columns = (
        Column("trial"),
        Column("steps to settle"),
        Column("overshoot", "N", digits=3),
        Column("steady error", "N", digits=3),
        Column("time to release", "s", digits=1),
        Column("largest u", "N", digits=2),
        Column("smallest u", "N", digits=2),
    )
    rows = (
        *(_row(trial, _words(trial)) for trial in trials.steady_states),
        *(_row(trial, f"{_words(trial)}, released") for trial in trials.step_responses),
    )
    note = (
        "Measured on the true force; a dash: it never settled within 5 % of the target, or was not released"
    )
    return Table("trials", "Closed loop", columns, rows, note)


def _row(trial: Trial, words: str) -> tuple[Cell, ...]:
    response = trial.response
    settled = None if math.isnan(response.settling_steps) else int(response.settling_steps)
    return (
        *(words, settled, response.overshoot, response.steady_state_error, response.release_time),
        *(response.largest_u, response.smallest_u),
    )


def _words(trial: Trial) -> str:
    return f"{trial.record.target[0]:.2f} N, K_P = {trial.gain:g}"


def _all(trials: ControllerStudy) -> tuple[Trial, ...]:
    return (*trials.steady_states, *trials.step_responses)


def _name_of(trial: Trial) -> str:
    kind = "step" if trial.record.target[-1] == 0 else "constant"
    return f"{kind}_{trial.record.target[0]:.2f}N_gain_{trial.gain:g}"


def _time_series(trial: Trial) -> str:
    """A trial as CSV, a row a step."""
    record = trial.record
    heads = ("time [s]", "target [N]", "F_net true [N]", "F_net measured [N]", "u [N]", "converged")
    columns = (record.time, record.target, record.true, record.estimated, record.command)
    rows = zip(*(column.tolist() for column in columns), record.converged.astype(int), strict=True)
    return as_csv(heads, rows, digits=9)
