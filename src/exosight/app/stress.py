"""The controllers under stress: run side by side, summed up, and written to a folder."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from exosight.app.console import progress, to_json
from exosight.app.control_figures import stress_figure
from exosight.app.nominal import camera_for
from exosight.control import ControllerConfig, OnnxEstimator, Proportional, guarded_of
from exosight.control.learned import FULL_AUTHORITY, NO_OVERLOAD
from exosight.control.policy_file import LearnedPolicy
from exosight.control.stress import ControllerName, StressConfig
from exosight.control.stress.episodes import draw_episode
from exosight.control.stress.frames import Look, camera_sensor, true_sensor
from exosight.control.stress.measures import Measured, attained, measure_episode, summary
from exosight.control.stress.oracle import run_oracle
from exosight.control.stress.plants import StressPlants, stress_plants
from exosight.control.stress.suite import Controller, Traces, Unguarded, run_episodes
from exosight.errors import InputError
from exosight.evaluation import Column, Table
from exosight.evaluation.figures import to_bytes
from exosight.exosuit.published import PublishedDesigns
from exosight.files import as_csv, write_new_file
from exosight.system.designs import DesignSet

ORACLE = "oracle"
"""Name of the bound."""


@dataclass(frozen=True)
class Outcome:
    """All episodes of one controller."""

    measured: tuple[Measured, ...]
    traces: Traces


def prepare(
    designs: DesignSet, model: Path | None, sensor: str | None = None, channel: str | None = None
) -> tuple[StressPlants, Look]:
    """What episodes are about, and their sensor: the network, or true readings.

    model   the network in the loop; None: the loop is closed on true readings

    Raises InputError for a sensor, channel or network that is none of the system's, DataError if the model
    cannot be read.
    """
    if model is None:
        return stress_plants(designs, None, sensor, channel), true_sensor
    estimator = OnnxEstimator.load(model, threads=2, history=False)
    camera = camera_for(designs, estimator) if isinstance(designs, PublishedDesigns) else None
    plants = stress_plants(designs, camera, sensor, channel)
    estimator.card.check_fits(plants.nominal.schema, "system")
    return plants, camera_sensor(estimator)


def run_stress(
    config: StressConfig,
    episodes: int,
    seed: int,
    controllers: Sequence[ControllerName],
    gains: Sequence[float],
    plants: StressPlants,
    look: Look,
    policy: LearnedPolicy | None = None,
) -> dict[str, Outcome]:
    """The named controllers and the paper's law with each gain, all on the same episodes.

    policy   of the learned controllers

    Raises InputError for settings that are out of range.
    """
    drawn = [draw_episode(config, seed, number, plants) for number in range(episodes)]
    outcomes = {}
    for name in (*controllers, *(f"K_P = {gain:g}" for gain in gains)):
        with progress(name, "steps") as update:
            if name == ORACLE:
                traces = run_oracle(drawn, plants.limits, update)
            else:
                chosen = _controllers(name, plants.limits, gains, episodes, policy)
                traces = run_episodes(drawn, chosen, look, plants.limits, update)
        measured = tuple(measure_episode(e, traces, i, plants.limits) for i, e in enumerate(drawn))
        outcomes[name] = Outcome(measured, traces)
    return outcomes


def _controllers(
    name: str, limits: ControllerConfig, gains: Sequence[float], count: int, policy: LearnedPolicy | None
) -> Sequence[Controller]:
    """One of this name for each episode."""
    if name in ("learned", "unguarded"):
        if policy is None:
            raise InputError(f"stress: expected a policy for the controller {name}; give --law")
        settings = (FULL_AUTHORITY, NO_OVERLOAD) if name == "unguarded" else (None, None)
        return [policy.controller(limits, *settings) for _ in range(count)]
    if name in ("guarded", "adaptive"):
        return [guarded_of(name, limits) for _ in range(count)]
    (gain,) = (gain for gain in gains if name == f"K_P = {gain:g}")
    return [Unguarded(Proportional(gain, limits.driven), limits.weights) for _ in range(count)]


def results(outcomes: Mapping[str, Outcome], about: Mapping[str, Any]) -> dict[str, Any]:
    """What was run, and the summary of each controller, as plain values.

    With the oracle among them, `attainable` counts the constant targets that it settles at, and which of
    these each controller does.
    """
    found = {name: summary(outcome.measured, outcome.traces) for name, outcome in outcomes.items()}
    if ORACLE in outcomes:
        bound = outcomes[ORACLE].measured
        for name, outcome in outcomes.items():
            found[name] |= attained(outcome.measured, bound)
    return {"about": dict(about), "controllers": found}


def write_stress(outcomes: Mapping[str, Outcome], found: Mapping[str, Any], folder: Path) -> None:
    """Write `results` (results.json), every episode (a CSV a controller) and the figure (SVG)."""
    write_new_file(folder / "results.json", to_json(found).encode())
    for name, outcome in outcomes.items():
        file = re.sub(r"\W+", "_", name)
        write_new_file(folder / f"{file}.csv", _rows(outcome.measured).encode())
    write_new_file(folder / "stress.svg", to_bytes(stress_figure(found)))


def stress_table(found: Mapping[str, Any]) -> Table:
    """What was measured, a row a controller; `found` as `results` gives it."""
    bounded = any("attained" in each for each in found["controllers"].values())
    columns = (
        Column("controller"),
        Column("targets settled"),
        *([Column("attainable targets settled")] if bounded else []),
        Column("settling steps, median", digits=0),
        Column("overshoot, 90th percentile", "%", digits=0),
        Column("steady-state error, median", "%", digits=1),
        Column("largest contact force, 99th percentile", "N", digits=2),
        Column("episodes beyond a contact limit"),
        Column("commands beyond limits"),
        Column("episodes released late (> 1 s)"),
        Column("episodes not recovered"),
        Column("episodes aborted by the guard"),
    )
    rows = tuple(
        (
            name,
            f"{each['settled']} of {each['constant_targets']}",
            *([f"{each['attained']} of {each['attainable']}"] if bounded else []),
            _of(each["settling_steps"], "median"),
            _of(each["overshoot_percent"], "p90"),
            _of(each["steady_state_percent"], "median"),
            _of(each["largest_contact"], "p99"),
            *(each[key] for key in ("outside_contact_limit", "commands_outside")),
            *(each[key] for key in ("released_late", "unrecovered", "given_up")),
        )
        for name, each in found["controllers"].items()
    )
    about = found["about"]
    note = f"{about['episodes']} episodes each, evaluated on true readings of {about['sensor']['name']}"
    return Table("stress", "Closed loop under stress", columns, rows, note)


def about(
    config: StressConfig,
    episodes: int,
    seed: int,
    gains: Sequence[float],
    model: Path | None,
    plants: StressPlants,
    law: Path | None = None,
) -> dict[str, Any]:
    """All that it takes to run it again."""
    config = replace(config, targets=config.targets or plants.targets)
    driven, controlled = plants.limits.driven, plants.limits.controlled
    return {
        "system": plants.limits.schema.system,
        "sensor": {"name": controlled.name, "unit": controlled.unit},
        "channel": {"name": driven.name, "unit": driven.unit},
        "contact_limit": _largest_limit(plants.limits),
        "episodes": episodes,
        "seed": seed,
        "model": None if model is None else model.name,
        **({} if law is None else {"law": law.name}),
        "gains": list(gains),
        "config": TypeAdapter(StressConfig).dump_python(config, mode="json"),
    }


def _largest_limit(limits: ControllerConfig) -> float | None:
    """Of the contact forces [N]; None if no one of them is estimated or limited."""
    forces = [spec.quantity == "contact force" for spec in limits.schema.estimated]
    own = limits.output_limits[forces]
    return float(own.max()) if own.size and np.isfinite(own).any() else None


def _of(quantiles: Mapping[str, float] | None, name: str) -> float | None:
    return None if quantiles is None else quantiles[name]


def _rows(measured: Sequence[Measured]) -> str:
    """Every episode as CSV; empty where something does not apply."""
    rows = ([number, *asdict(one).values()] for number, one in enumerate(measured))
    return as_csv(["episode", *asdict(measured[0])], rows)
