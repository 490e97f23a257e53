"""Figures and tables of docs/control.md: the paper's Figs. 6 and 7 reproduced; some minutes on one core.

`python docs/figures_control.py` simulates and draws; with `--draw` it draws what docs/results holds.
"""

import json
import sys
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from _parts.pages import fill, save, table_of
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from exosight.app.pipeline import camera_of
from exosight.control import (
    CONTROL_SHAPE,
    ControllerConfig,
    Guarded,
    Measure,
    OnnxEstimator,
    OpenLoop,
    Plant,
    Proportional,
    Record,
    Scheduled,
    Sense,
    from_image,
    hold,
    hold_and_release,
    measure_response,
    measurement_from,
    run,
    run_guarded,
    true_measurement,
    true_reading,
)
from exosight.control.calibration import calibrate_estimator
from exosight.control.estimator import SHIPPED_MODELS
from exosight.control.scheduled import RELEASED
from exosight.control.simulated import SimulatedPlant
from exosight.control.trials import (
    STEADY_STATE_GAIN,
    STEADY_STATE_STEPS,
    STEADY_STATE_TARGETS,
    STEP_GAINS,
    STEP_SECONDS,
    STEP_TARGET,
)
from exosight.control.tuning import tune
from exosight.evaluation.figures.style import (
    BLACK,
    BLUE,
    GRAY,
    GREEN,
    VERMILION,
    legend_above,
    new_figure,
    styled,
)
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import Preset, published

HERE = Path(__file__).parent
PAGE, RESULT, IMAGES = HERE / "control.md", HERE / "results" / "control.json", HERE / "images"

STIFFER = 1.2
"""Factor on the modulus of the exosuit that the controller was not tuned for."""

PAPER = {"0.25 N": 7, "0.30 N": 5, "0.35 N": 14}
"""Steps to settle with K_P = 5."""
PAPER_STEP = {
    "0.1": "u reaches at most 1.6 N",
    "1": "u about 2.4 N, then −1 N; returns",
    "100": "stays at 0.23 N from 2.6 s on",
}

LAW, LAW_IMAGE = "paper's law, true force", "paper's law, image"
OPEN, OPEN_WRONG = "open loop", f"open loop, modulus × {STIFFER:g}"
OURS, OURS_IMAGE = "guarded, true force", "guarded, image"
LAW_OWN, OURS_OWN = "paper's law, image, calibrated", "guarded, image, calibrated"
COLOURS = (BLUE, VERMILION, GREEN)


def measure(preset: Preset = published) -> dict[str, Any]:
    """Every run of both figures: traces and measures by controller and target, or gain."""
    estimator = OnnxEstimator.load(SHIPPED_MODELS[preset(CONTROL_SHAPE).name])
    camera, exosuit = camera_of(estimator.card), Exosuit(CONTROL_SHAPE)
    system = preset(exosuit, camera)
    plant, config = SimulatedPlant(system), tune(system)
    stiffer = SimulatedPlant(preset(replace(exosuit, young=STIFFER * exosuit.young), camera))
    constants = {f"{force:.2f} N": hold(force, STEADY_STATE_STEPS) for force in STEADY_STATE_TARGETS}
    step = hold_and_release(STEP_TARGET, round(STEP_SECONDS * 10))
    own = calibrate_estimator(estimator, system, config)

    def paper(measured: Measure) -> dict[str, Any]:
        law = Proportional(STEADY_STATE_GAIN, config.driven)
        return {name: _trace(run(plant, law, measured, target)) for name, target in constants.items()}

    def ours(sense: Sense, targets: Mapping[str, np.ndarray]) -> dict[str, Any]:
        return {name: _guarded(plant, config, sense, target) for name, target in targets.items()}

    def without(plant: Plant, targets: Mapping[str, np.ndarray]) -> dict[str, Any]:
        return {n: _trace(run(plant, OpenLoop(config), true_reading(), t)) for n, t in targets.items()}

    def gains(measured: Measure) -> dict[str, Any]:
        return {
            f"{gain:g}": _trace(run(plant, Proportional(gain, config.driven), measured, step))
            for gain in STEP_GAINS
        }

    return {
        "constant": {
            LAW: paper(true_reading()),
            LAW_IMAGE: paper(from_image(estimator, system.schema)),
            LAW_OWN: paper(from_image(own, system.schema)),
            OPEN: without(plant, constants),
            OPEN_WRONG: without(stiffer, constants),
            OURS: ours(true_measurement, constants),
            OURS_IMAGE: ours(measurement_from(estimator), constants),
            OURS_OWN: ours(measurement_from(own), constants),
        },
        "step": {
            LAW: gains(true_reading()),
            LAW_IMAGE: gains(from_image(estimator, system.schema)),
            LAW_OWN: gains(from_image(own, system.schema)),
            OPEN: without(plant, {"": step}),
            OPEN_WRONG: without(stiffer, {"": step}),
            OURS: ours(true_measurement, {"": step}),
            OURS_IMAGE: ours(measurement_from(estimator), {"": step}),
            OURS_OWN: ours(measurement_from(own), {"": step}),
        },
        "jumps": {"up": _jumps(config.loading), "down": _jumps(config.unloading)},
    }


def load() -> dict[str, Any]:
    """The stored results."""
    return json.loads(RESULT.read_text())


def _guarded(plant: Plant, config: ControllerConfig, sense: Sense, target: np.ndarray) -> dict[str, Any]:
    guarded = Guarded(Scheduled(config))
    found = _trace(run_guarded(plant, guarded, sense, target))
    return {**found, "log": [f"step {t.step}: {t.after.value}, {t.cause}" for t in guarded.log]}


def _trace(record: Record) -> dict[str, Any]:
    """A run as plain numbers."""
    response = measure_response(record.time, record.target, record.true, record.command, record.driven)
    held = record.target > 0
    pressing = np.flatnonzero(record.true[~held] >= RELEASED)
    released = (0 if not len(pressing) else int(pressing[-1]) + 1) / 10
    return {
        **{key: None if value != value else value for key, value in asdict(response).items()},
        "seconds_to_5_mN": released if record.true[-1] < RELEASED else None,
        "last": round(float(record.true[-1]), 4),
        "target": record.target.tolist(),
        "true": record.true.round(4).tolist(),
        "estimated": record.estimated.round(4).tolist(),
        "u": record.command.round(4).tolist(),
    }


def _jumps(path: Any) -> list[dict[str, float]]:
    """Where a path jumps: u [N], and F_net [N] before and after."""
    return [
        {"u": round(float(path.u[i]), 3), "before": round(before, 4), "after": round(after, 4)}
        for i, (before, after) in zip(np.flatnonzero(path.snapped), path.jumps, strict=True)
    ]


@styled
def constant(found: dict[str, Any]) -> Figure:
    """F_net and u for the three constant targets, one column per controller (the paper's Fig. 6)."""
    columns = (LAW, LAW_IMAGE, OPEN_WRONG, OURS_OWN)
    figure = new_figure(height=3.6)
    panels = figure.subplots(2, len(columns), sharex=True, sharey="row", height_ratios=(3, 2))
    for (above, below), name in zip(panels.T, columns, strict=True):
        for trace, colour in zip(found[name].values(), COLOURS, strict=True):
            _draw(above, below, trace, colour)
        above.set_title(name.replace(", ", "\n", 1))
        below.set_xlabel("time [s]")
    _finish(figure, panels, [f"target {name}" for name in found[LAW]])
    return figure


@styled
def steps(found: dict[str, Any]) -> Figure:
    """F_net and u while 0.2 N is held for 10 s and then released, one column per controller (Fig. 7)."""
    columns = (LAW, LAW_IMAGE, OPEN_WRONG, OURS_OWN)
    figure = new_figure(height=3.6)
    panels = figure.subplots(2, len(columns), sharex=True, sharey="row", height_ratios=(3, 2))
    for (above, below), name in zip(panels.T, columns, strict=True):
        gains = list(found[LAW])
        for label, trace in found[name].items():
            colour = COLOURS[gains.index(label)] if label in gains else BLACK
            _draw(above, below, trace, colour, at_back=label == "100")
        above.set_title(name.replace(", ", "\n", 1))
        below.set_xlabel("time [s]")
    panels[0, 0].set_ylim(-0.02, 0.45)  # K_P = 100 exceeds it
    _finish(figure, panels, [f"K_P = {gain}" for gain in found[LAW]])
    return figure


def _draw(above: Any, below: Any, trace: dict[str, Any], colour: str, at_back: bool = False) -> None:
    time, z = np.arange(len(trace["true"])) / 10, 1.5 if at_back else 2
    width = 0.6 if at_back else 1.2
    above.plot(time, trace["target"], color=GRAY, linewidth=0.8, linestyle="--", drawstyle="steps-post")
    above.plot(time, trace["true"], color=colour, linewidth=width, zorder=z)
    above.plot(time, trace["estimated"], color=colour, linestyle=":", linewidth=width, zorder=z)
    below.plot(time, trace["u"], color=colour, linewidth=width, zorder=z)


def _finish(figure: Figure, panels: np.ndarray, names: list[str]) -> None:
    panels[0, 0].set_ylabel("F_net [N]")
    panels[1, 0].set_ylabel("u [N]")
    for ax in panels.flat:
        ax.grid(axis="y")
    keys = [Line2D([], [], color=colour) for colour in COLOURS]
    keys += [
        Line2D([], [], color=BLACK),
        Line2D([], [], color=BLACK, linestyle=":"),
        Line2D([], [], color=GRAY, linestyle="--", linewidth=0.8),
    ]
    legend_above(figure, keys, [*names, "true", "input to the controller", "target"])


def tables(found: dict[str, Any]) -> dict[str, str]:
    """The page's tables, by name."""
    constants = [["steps to settle, paper", *(str(PAPER[target]) for target in PAPER), "–", "–"]]
    for name, runs in found["constant"].items():
        own = [runs[target] for target in PAPER]
        constants.append(
            [
                name,
                *(settled(trace) for trace in own),
                " / ".join(f"{trace['overshoot_percent']:.0f}" for trace in own),
                " / ".join(percent(trace) for trace in own),
            ]
        )
    rows = [[f"paper, K_P = {gain}", words, "–", "–", "–"] for gain, words in PAPER_STEP.items()]
    for name, runs in found["step"].items():
        for gain, trace in runs.items():
            rows.append(
                [
                    name + (f", K_P = {gain}" if gain else ""),
                    settled(trace),
                    f"{trace['largest_u']:.2f}, {trace['smallest_u']:.2f}".replace("-", "−"),
                    "never" if trace["seconds_to_5_mN"] is None else f"{trace['seconds_to_5_mN']:.1f}",
                    f"{trace['last']:.3f}",
                ]
            )
    jumps = [
        [f"u {way}", f"{jump['u']:.3f}", f"{jump['before']:.3f}", f"{jump['after']:.3f}"]
        for way, name in (("rising", "up"), ("falling", "down"))
        for jump in found["jumps"][name]
    ]
    return {
        "constant": table_of(
            ["controller and sensor", *PAPER, "overshoot [%]", "steady-state error [%]"], constants
        ),
        "step": table_of(
            [
                "controller and sensor",
                "steps to settle at 0.2 N",
                "largest and smallest u [N]",
                "time from the release until F_net < 5 mN [s]",
                "final F_net [N]",
            ],
            rows,
        ),
        "jumps": table_of(["path", "u [N]", "F_net before [N]", "F_net after [N]"], jumps),
    }


def settled(trace: dict[str, Any]) -> str:
    """Steps to settle, or what it does instead."""
    if trace["settling_steps"] is not None:
        return f"{trace['settling_steps']:.0f}"
    held = sum(force > 0 for force in trace["target"])
    late = np.array(trace["true"][held - held // 4 : held])
    if trace["ripple"] < 0.01:
        return "steady-state error"
    return "not settled" if (np.diff(late) >= 0).all() else f"oscillates by {trace['ripple']:.2f} N"


def percent(trace: dict[str, Any]) -> str:
    """The steady-state error as a share of the target [%]."""
    return f"{100 * abs(trace['steady_state_error']) / trace['target'][0]:.1f}"


def main() -> None:
    """Simulate, unless `--draw` is given; write figures and page."""
    if "--draw" not in sys.argv[1:]:
        RESULT.write_text(json.dumps(measure()) + "\n")
    found = load()
    for name, figure in {"constant": constant(found["constant"]), "step": steps(found["step"])}.items():
        save(figure, IMAGES / f"control_{name}.png")
    fill(PAGE, tables(found))


if __name__ == "__main__":
    main()
