"""`exosight control`: the closed loop, with a network or the true force as its sensor."""

import csv
import io
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import tyro

from exosight.app.console import progress, show, write_json
from exosight.app.pipeline import camera_of
from exosight.control import CONTROL_SHAPE, Measure, OnnxEstimator, Trial, from_image, true_force
from exosight.dataset.files import write_new_file
from exosight.errors import DataError
from exosight.evaluation import Column, Table, figures
from exosight.exosuit.shapes import shape_to_dict
from exosight.vision.camera import Camera


def control(
    model: Path | None = None,
    out: Path | None = None,
    json: Annotated[str | None, tyro.conf.arg(metavar="FILE|-")] = None,
) -> None:
    """Run the paper's six closed-loop trials on a simulated exosuit.

    Constant targets 0.25, 0.30, 0.35 N with K_P = 5, and a step of 0.2 N for 10 s, then 0 N, with K_P = 0.1,
    1 and 100. The sensor is a network that sees the camera image; without one it is the true force.

    Example: exosight control --model results/light/model.onnx --out results/control

    Args:
        model: exported network, from `exosight train`; default: the true force
        out: folder for time series (CSV), figures (SVG), results and configuration (JSON); it must not exist
        json: write the results as JSON to a new file, or to stdout with "-", instead of a table
    """
    if out is not None and out.exists():
        raise DataError(f"{out}: exists already; name a new folder, nothing is overwritten")
    camera, measure = Camera(), true_force
    if model is not None:
        estimator = OnnxEstimator.load(model)
        camera, measure = camera_of(estimator.card), from_image(estimator)
    trials = run_trials(camera, measure)
    results = [summary(trial) for trial in trials]
    if json is None:
        show(_table(trials))
    else:
        write_json({"trials": results}, json)
    if out is None:
        return
    out.mkdir(parents=True)
    for trial in trials:
        write_new_file(out / f"{name_of(trial)}.csv", time_series(trial).encode())
    steady, steps = trials[:3], trials[3:]
    drawings = {
        "steady_states": figures.steady_states([trial.record for trial in steady]),
        "step_responses": figures.step_responses({trial.gain: trial.record for trial in steps}),
    }
    for name, figure in drawings.items():
        write_new_file(out / f"{name}.svg", figures.to_svg(figure))
    config = {"model": model and str(model), "camera": asdict(camera), "shape": shape_to_dict(CONTROL_SHAPE)}  # type: ignore[call-overload]
    write_json({"config": config, "trials": results}, str(out / "results.json"))


def run_trials(camera: Camera, measure: Measure) -> tuple[Trial, ...]:
    """The six trials on a fresh simulated plant: constant targets first, then step responses."""
    from exosight.control import study
    from exosight.control.simulated import SimulatedPlant
    from exosight.exosuit.assembly import Exosuit

    finished = 0
    with progress("closed loop", "trials") as update:
        update(0, 6)

        def done(_: Trial) -> None:
            nonlocal finished
            finished += 1
            update(finished, 6)

        found = study(SimulatedPlant(Exosuit(CONTROL_SHAPE), camera), measure, done)
    return (*found.steady_states, *found.step_responses)


def name_of(trial: Trial) -> str:
    """File name of a trial: its target, and its gain."""
    kind = "step" if trial.record.target[-1] == 0 else "constant"
    return f"{kind}_{trial.record.target[0]:.2f}N_gain_{trial.gain:g}"


def summary(trial: Trial) -> dict[str, Any]:
    """What was measured on a trial as plain values with units; None where something never happened."""
    response = {key: None if value != value else value for key, value in asdict(trial.response).items()}
    return {"name": name_of(trial), "gain": trial.gain, "target": float(trial.record.target[0]), **response}


def time_series(trial: Trial) -> str:
    """A trial as CSV, a row a step."""
    record = trial.record
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["time [s]", "target [N]", "F_net true [N]", "F_net measured [N]", "u [N]", "converged"])
    columns = (record.time, record.target, record.F_net_true, record.F_net_estimated, record.u)
    for row in zip(*columns, record.converged, strict=True):
        writer.writerow([*(f"{value:.9g}" for value in row[:-1]), int(row[-1])])
    return buffer.getvalue()


def _table(trials: tuple[Trial, ...]) -> Table:
    columns = (
        Column("trial"),
        Column("steps to settle"),
        Column("overshoot", "N", digits=3),
        Column("steady-state error", "N", digits=3),
        Column("time to release", "s", digits=1),
        Column("largest u", "N", digits=2),
        Column("smallest u", "N", digits=2),
    )
    rows = []
    for trial in trials:
        r = trial.response
        settled = None if r.settling_steps != r.settling_steps else int(r.settling_steps)
        rows.append(
            (
                f"{trial.record.target[0]:.2f} N, K_P = {trial.gain:g}"
                + (", released" if len(trial.record.u) > 100 else ""),
                *(settled, r.overshoot, r.steady_state_error, r.release_time, r.largest_u, r.smallest_u),
            )
        )
    note = (
        "Measured on the true force; a dash: it never settled within 5 % of the target, or was not released"
    )
    return Table("trials", "Closed loop", columns, tuple(rows), note)
