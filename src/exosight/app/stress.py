"""The controllers under stress: run side by side, summed up, and written to a folder."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np
from pydantic import TypeAdapter

from exosight.app.console import progress, to_json
from exosight.app.control_figures import stress_figure
from exosight.app.nominal import camera_for
from exosight.control import ControllerConfig, GuardConfig, OnnxEstimator, Proportional, guarded_of
from exosight.control.guarded import GuardedName
from exosight.control.learned import FULL_AUTHORITY, NO_OVERLOAD
from exosight.control.policy_file import LearnedPolicy
from exosight.control.stress import ControllerName, StressConfig
from exosight.control.stress.causes import Causes, find_causes, worst
from exosight.control.stress.config import guard_of
from exosight.control.stress.episodes import Episode, draw_episode
from exosight.control.stress.frames import Look, camera_sensor, last_seen, true_sensor
from exosight.control.stress.measures import Measured, attained, measure_episode, summary
from exosight.control.stress.oracle import run_oracle
from exosight.control.stress.plants import StressPlants, stress_plants
from exosight.control.stress.recorded import record_episodes
from exosight.control.stress.suite import Controller, Traces, Unguarded, run_episodes
from exosight.errors import InputError
from exosight.evaluation import Column, Table
from exosight.evaluation.figures import to_bytes
from exosight.exosuit.published import PublishedDesigns
from exosight.files import as_csv, write_new_file
from exosight.system.designs import DesignSet

ORACLE, DELAYED_ORACLE = "oracle", "delayed-oracle"
"""Names of the bounds: of what the actuators allow, and of what the frames tell as well."""


@dataclass(frozen=True)
class Outcome:
    """All episodes of one controller, and perhaps why some failed."""

    measured: tuple[Measured, ...]
    traces: Traces
    causes: Causes | None = None


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
    causes: int = 0,
    policy: LearnedPolicy | None = None,
) -> dict[str, Outcome]:
    """The named controllers and the paper's law with each gain, all on the same episodes.

    causes   failures of each controller that are run again without one disturbance at a time
              which needs the oracle among them
    policy   of the learned controllers

    Raises InputError for settings that are out of range.
    """
    drawn = [draw_episode(config, seed, number, plants) for number in range(episodes)]
    guard = guard_of(config)
    outcomes: dict[str, Outcome] = {}
    for name in (*controllers, *(f"K_P = {gain:g}" for gain in gains)):
        outcomes[name] = _run(name, drawn, gains, plants, look, guard, policy)
    if not causes:
        return outcomes

    def explained(name: str, outcome: Outcome) -> Outcome:
        found = find_causes(
            drawn,
            outcome.measured,
            outcomes[ORACLE].measured,
            lambda others: _run(name, others, gains, plants, look, guard, policy).measured,
            plants.nominal,
            causes,
        )
        return replace(outcome, causes=found)

    return {name: own if name == ORACLE else explained(name, own) for name, own in outcomes.items()}


def _run(
    name: str,
    drawn: Sequence[Episode],
    gains: Sequence[float],
    plants: StressPlants,
    look: Look,
    guard: GuardConfig,
    policy: LearnedPolicy | None,
) -> Outcome:
    """One controller on all of these episodes."""
    with progress(name, "steps") as update:
        if name in (ORACLE, DELAYED_ORACLE):
            seen = last_seen(drawn) if name == DELAYED_ORACLE else None
            traces = run_oracle(drawn, plants.limits, update, seen)
        else:
            chosen = _controllers(name, plants.limits, gains, len(drawn), guard, policy)
            traces = run_episodes(drawn, chosen, look, plants.limits, update)
    return Outcome(tuple(measure_episode(e, traces, i, plants.limits) for i, e in enumerate(drawn)), traces)


def save_worst(
    outcomes: Mapping[str, Outcome],
    config: StressConfig,
    seed: int,
    plants: StressPlants,
    look: Look,
    model: Path,
    folder: Path,
    count: int,
) -> None:
    """Run the worst episodes of each controller with a guard once more, and write them as recordings."""
    for name, outcome in outcomes.items():
        if name in get_args(GuardedName):
            numbers = worst(outcome.measured, count)
            record_episodes(
                [draw_episode(config, seed, number, plants) for number in numbers],
                [folder / f"{name}_{number:04}.h5" for number in numbers],
                cast(GuardedName, name),
                look,
                plants.limits,
                model,
                guard_of(config),
            )


def _controllers(
    name: str,
    limits: ControllerConfig,
    gains: Sequence[float],
    count: int,
    guard: GuardConfig,
    policy: LearnedPolicy | None,
) -> Sequence[Controller]:
    """One of this name for each episode."""
    if name in ("learned", "unguarded"):
        if policy is None:
            raise InputError(f"stress: expected a policy for the controller {name}; give --law")
        settings = (FULL_AUTHORITY, NO_OVERLOAD) if name == "unguarded" else (None, guard)
        return [policy.controller(limits, *settings) for _ in range(count)]
    if name in ("guarded", "adaptive"):
        return [guarded_of(name, limits, guard) for _ in range(count)]
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
            if outcome.causes is not None:
                found[name] |= {"causes": _plain(outcome.causes)}
    return {"about": dict(about), "controllers": found}


def _plain(causes: Causes) -> dict[str, Any]:
    counts = {
        name: {"failed_with_it": having, "not_failed_without_it": without}
        for name, (having, without) in causes.counts.items()
    }
    return {"episodes": list(causes.episodes), "disturbances": counts}


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


def cause_tables(found: Mapping[str, Any]) -> list[Table]:
    """Why episodes failed, a row a disturbance, a column a controller; none where it was not asked for."""
    causes = {name: each["causes"] for name, each in found["controllers"].items() if "causes" in each}
    if not causes:
        return []
    columns = [Column("disturbance")]
    for name, each in causes.items():
        columns.append(Column(f"{name}: of {len(each['episodes'])} failures with it, not failing without it"))
    disturbances = dict.fromkeys(d for each in causes.values() for d in each["disturbances"])
    rows = tuple(
        (
            disturbance,
            *(
                f"{own['not_failed_without_it']} of {own['failed_with_it']}" if own else None
                for own in (each["disturbances"].get(disturbance) for each in causes.values())
            ),
        )
        for disturbance in disturbances
    )
    return [Table("causes", "Failures without one disturbance", tuple(columns), rows, "")]


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
    config = replace(config.complete(), targets=config.targets or plants.targets)
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
