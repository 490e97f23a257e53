"""The controllers under stress: run side by side, summed up, and written to a folder."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from pydantic import TypeAdapter

from exosight.app.console import progress, to_json
from exosight.app.pipeline import camera_of
from exosight.control import CONTROL_SHAPE, ControllerConfig, Guarded, OnnxEstimator, Proportional, Scheduled
from exosight.control.stress import StressConfig
from exosight.control.stress.episodes import draw_episode
from exosight.control.stress.frames import camera_sensor, true_sensor
from exosight.control.stress.measures import RELEASE_SECONDS, Measured, measure_episode, summary
from exosight.control.stress.suite import Controller, Traces, Unguarded, run_episodes
from exosight.control.tuning import CONTACT_LIMIT, tune
from exosight.evaluation import Column, Table, figures
from exosight.evaluation.figures.stress import Spread
from exosight.exosuit.assembly import Exosuit
from exosight.files import as_csv, write_new_file
from exosight.system.camera import Camera

GUARDED = "guarded"
"""Name of the scheduled law behind its guard."""


@dataclass(frozen=True)
class Outcome:
    """All episodes of one controller."""

    measured: tuple[Measured, ...]
    traces: Traces


def run_stress(
    config: StressConfig, episodes: int, seed: int, model: Path | None, gains: Sequence[float]
) -> dict[str, Outcome]:
    """The guarded controller and the paper's law with each gain, all on the same episodes.

    model   the network in the loop; None: the loop is closed on the true force

    Raises InputError for settings that are out of range, DataError if the model cannot be read.
    """
    estimator = None if model is None else OnnxEstimator.load(model, threads=2, alone=True)
    camera = Camera() if estimator is None else camera_of(estimator.card)
    sensor = true_sensor if estimator is None else camera_sensor(estimator)
    drawn = [draw_episode(config, seed, number, camera) for number in range(episodes)]
    limits = tune(Exosuit(CONTROL_SHAPE))
    outcomes = {}
    for name, controllers in _controllers(limits, gains, episodes).items():
        with progress(name, "steps") as update:
            traces = run_episodes(drawn, controllers, sensor, update)
        measured = tuple(measure_episode(e, traces, i, limits) for i, e in enumerate(drawn))
        outcomes[name] = Outcome(measured, traces)
    return outcomes


def _controllers(
    limits: ControllerConfig, gains: Sequence[float], count: int
) -> dict[str, Sequence[Controller]]:
    def paper(gain: float) -> Sequence[Controller]:
        return [Unguarded(Proportional(gain)) for _ in range(count)]

    guarded: Sequence[Controller] = [Guarded(Scheduled(limits)) for _ in range(count)]
    return {GUARDED: guarded, **{f"K_P = {gain:g}": paper(gain) for gain in gains}}


def results(outcomes: Mapping[str, Outcome], about: Mapping[str, Any]) -> dict[str, Any]:
    """What was run, and the summary of each controller, as plain values."""
    found = {name: summary(outcome.measured, outcome.traces) for name, outcome in outcomes.items()}
    return {"about": dict(about), "controllers": found}


def write_stress(outcomes: Mapping[str, Outcome], found: Mapping[str, Any], folder: Path) -> None:
    """Write `results` (results.json), every episode (a CSV a controller) and the figure (SVG)."""
    write_new_file(folder / "results.json", to_json(found).encode())
    for name, outcome in outcomes.items():
        file = re.sub(r"\W+", "_", name)
        write_new_file(folder / f"{file}.csv", _rows(outcome.measured).encode())
    write_new_file(folder / "stress.svg", figures.to_svg(draw(found)))


def draw(found: Mapping[str, Any]) -> Figure:
    """How the episodes are spread; `found` as `results` gives it."""

    def spread(label: str, field: str, limit: float | None, largest: float) -> Spread:
        values = {
            name: np.array(told["percentiles"][field], dtype=float)  # None becomes NaN
            for name, told in found["controllers"].items()
        }
        return Spread(label, values, limit, largest)

    return figures.stress(
        [
            spread("steps to settle at a constant target [-]", "settling_steps", None, 25.0),
            spread("overshoot of a constant target [%]", "overshoot_percent", None, 100.0),
            spread("largest force on one contact [N]", "largest_contact", CONTACT_LIMIT, 1.5),
            spread("time from the target's drop to release [s]", "release_seconds", RELEASE_SECONDS, 1.5),
        ]
    )


def stress_table(found: Mapping[str, Any]) -> Table:
    """What was measured, a row a controller; `found` as `results` gives it."""
    columns = (
        Column("controller"),
        Column("constant targets settled"),
        Column("steps to settle, median", digits=0),
        Column("overshoot, 90 %", "%", digits=0),
        Column("steady-state error, median", "%", digits=1),
        Column("largest contact force, 99 %", "N", digits=2),
        Column("episodes with a contact beyond its limit"),
        Column("commands beyond limits"),
        Column("episodes released after 1 s or never"),
        Column("episodes unrecovered"),
        Column("episodes given up by the guard"),
    )
    rows = tuple(
        (
            name,
            f"{told['settled']} of {told['constant_targets']}",
            _of(told["settling_steps"], "median"),
            _of(told["overshoot_percent"], "p90"),
            _of(told["steady_state_percent"], "median"),
            _of(told["largest_contact"], "p99"),
            *(told[key] for key in ("outside_contact_limit", "commands_outside")),
            *(told[key] for key in ("released_late", "unrecovered", "given_up")),
        )
        for name, told in found["controllers"].items()
    )
    note = f"{found['about']['episodes']} episodes each, judged on the true force"
    return Table("stress", "Closed loop under stress", columns, rows, note)


def about(
    config: StressConfig, episodes: int, seed: int, model: Path | None, gains: Sequence[float]
) -> dict[str, Any]:
    """All that it takes to run it again."""
    return {
        "episodes": episodes,
        "seed": seed,
        "model": None if model is None else model.name,
        "gains": list(gains),
        "config": TypeAdapter(StressConfig).dump_python(config, mode="json"),
    }


def _of(quantiles: Mapping[str, float] | None, name: str) -> float | None:
    return None if quantiles is None else quantiles[name]


def _rows(measured: Sequence[Measured]) -> str:
    """Every episode as CSV; empty where something does not apply."""
    rows = ([number, *asdict(one).values()] for number, one in enumerate(measured))
    return as_csv(["episode", *asdict(measured[0])], rows)
