"""`--plot FILE`: what a command found as one figure."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from exosight.app.console import say
from exosight.control.estimator import Reading
from exosight.control.paths import ControllerConfig
from exosight.control.recording import Recording
from exosight.control.replay import Replay
from exosight.control.trials import Trial
from exosight.evaluation.figures import Curve, Panel, curves, to_bytes
from exosight.files import write_new_file
from exosight.learning.large_error import LIKELY
from exosight.system.motion import SystemMotion
from exosight.system.schema import Schema
from exosight.system.simulation import SystemStates
from exosight.system.system import System

TIME = "time [s]"
MOST_PROFILES = 6
"""Loads of which profiles are drawn in one panel; more are picked evenly."""


def write_plot(figure: Figure, path: Path) -> None:
    """Write a Matplotlib figure to a new PNG, PDF or SVG file, see `exosight.app.output.check_plot`."""
    write_new_file(path, to_bytes(figure, path.suffix[1:]))
    say(f"wrote {path}")


def plot_path(
    system: System,
    states: SystemStates | SystemMotion,
    profiles: Mapping[str, np.ndarray],
    lost: Sequence[bool],
) -> Figure:
    """The readings of a system over its command, of several channels over the number of the load, or over
    the time; and the force per length along its tubes.

    profiles   of all states, see `force_profiles`
    lost       loads without an equilibrium, which are left out
    """
    schema, commands = system.schema, states.commands
    if states.times is not None:
        x, label = states.times, TIME
        names = [f"{time:g} s" for time in x]
    elif len(schema.channels) == 1:
        (channel,) = schema.channels
        x, label = commands[:, 0], f"{channel.name} [{channel.unit}]"
        names = [f"{channel.name} = {u:g} {channel.unit}" for u in x]
    else:
        x, label = np.arange(1.0, len(commands) + 1), "number of the load [-]"
        names = [f"load {number:g}" for number in x]
    order = np.argsort(x, kind="stable")
    y = np.where(np.asarray(lost)[:, None], np.nan, np.asarray(states.observation.readings, float))
    found: dict[str, list[Curve]] = {}
    for column, sensor in enumerate(schema.sensors):
        if sensor.quantity != "force per length":  # drawn along the tube
            curve = Curve(sensor.name, x[order], y[order, column])
            found.setdefault(f"{sensor.quantity} [{sensor.unit}]", []).append(curve)
    panels = [_panel(name, lines) for name, lines in found.items()]
    kept = list({names[i]: int(i) for i in order if not lost[i]}.values())  # equal loads end in one state
    picked = np.linspace(0, len(kept) - 1, min(len(kept), MOST_PROFILES)).astype(int)
    drawn = {kept[i]: names[kept[i]] for i in picked}
    return curves(label, [*panels, *_profile_panels(system, profiles, drawn)])


def _profile_panels(
    system: System, profiles: Mapping[str, np.ndarray], names: Mapping[int, str]
) -> Iterator[Panel]:
    """Force per length along every tube at some loads, by their numbers; its tangential part if there is one.

    Where the links of a chain meet is marked.
    """
    for tube in system.tubes:
        if f"place_{tube.name}" not in profiles:
            continue
        places, whole, normal = (
            profiles[f"{what}_{tube.name}"] for what in ("place", "force_per_length", "normal_per_length")
        )
        nodes = np.asarray(tube.along(system.robot))
        ends = [] if len(tube.bodies) == 1 else 1e3 * nodes[1:-1]
        for part, vectors in (("", whole), ("tangential ", whole - normal)):
            # Constant beyond the last places.
            sizes = {i: np.pad(np.linalg.norm(vectors[i], axis=-1), 1, mode="edge") for i in names}
            top = max((size.max() for size in sizes.values()), default=0.0)
            if top == 0:
                continue
            lines = [
                Curve(names[i], 1e3 * np.array([0, *places[i], nodes[-1]]), size) for i, size in sizes.items()
            ]
            for number, end in enumerate(ends):  # Matplotlib leaves names with _ out of the legend
                name = "_" if number else "ends of links"
                lines.append(Curve(name, np.full(2, end), np.array([0, top]), target=True))
            yield Panel(
                f"{part}force per length\non {tube.name} [N/m]",
                tuple(lines),
                x_label=f"distance along {tube.name} [mm]",
            )


def plot_trials(trials: Sequence[Trial]) -> Figure:
    """Sensor and command of every trial over time, constant targets apart from those that are released."""
    panels = []
    for released in (False, True):
        # The largest gain swings most, so it is drawn first and lies at the back.
        chosen = [trial for trial in sorted(trials, key=lambda t: -t.gain) if trial.released == released]
        if not chosen:
            continue
        sensor, channel = chosen[0].record.controlled, chosen[0].record.driven
        forces, commands = [], []
        for trial in chosen:
            record, target = trial.record, f"{trial.record.target[0]:g} {sensor.unit}"
            name = f"{target}, {trial.law}" if trial.law else target
            forces.append(Curve(name, record.time, record.true))
            commands.append(Curve(name, record.time, record.command))
        targets = {tuple(trial.record.target): trial.record for trial in chosen}.values()
        for number, record in enumerate(targets):  # Matplotlib leaves names with _ out of the legend
            name = "_target" if number else "target"
            forces.append(Curve(name, record.time, record.target, target=True))
        panels.append(Panel(f"true {sensor.name} [{sensor.unit}]", tuple(forces)))
        panels.append(Panel(f"{channel.name} [{channel.unit}]", tuple(commands)))
    return curves(TIME, panels)


def plot_run(config: ControllerConfig, run: Mapping[str, Float[np.ndarray, " steps"]]) -> Figure:
    """The controlled sensor and the command of a run in real time.

    run   time [s], target, estimated, true, command by these names; NaN where something is unknown
    """
    time, sensor, channel = run["time"], config.controlled, config.driven
    lines = [Curve("estimated", time, run["estimated"])]
    if not np.isnan(run["true"]).all():
        lines.append(Curve("true", time, run["true"]))
    lines.append(Curve("target", time, run["target"], target=True))
    return curves(
        TIME,
        [
            _panel(f"{sensor.name} [{sensor.unit}]", lines),
            _panel(f"{channel.name} [{channel.unit}]", [Curve("command", time, run["command"])]),
        ],
    )


def plot_replay(recorded: Recording, again: Replay) -> Figure:
    """The controlled sensor and the command as recorded and as replayed."""
    config, time = recorded.controller, recorded.time
    sensor, channel = config.controlled, config.driven

    def both(of: Recording | Replay) -> tuple[np.ndarray, np.ndarray]:
        known = recorded.has_estimate
        return np.where(known, of.estimated.astype(float) @ config.weights, np.nan), of.command

    (force, u), (force_again, u_again) = both(recorded), both(again)
    target = Curve("target", time, recorded.target, target=True)
    forces = [Curve("recorded", time, force), Curve("replayed", time, force_again), target]
    commands = [Curve("recorded", time, u), Curve("replayed", time, u_again)]
    return curves(
        TIME,
        [
            _panel(f"{sensor.name} [{sensor.unit}]", forces),
            _panel(f"{channel.name} [{channel.unit}]", commands),
        ],
    )


def plot_estimates(schema: Schema, readings: Sequence[Reading]) -> Figure:
    """Each estimated sensor with its interval over the number of the picture, and whether to trust it.

    The last is the probability of a large error, or of networks without it the OOD score.
    """
    number = np.arange(1.0, len(readings) + 1)
    values, low, high = (
        np.concatenate(parts).astype(float)
        for parts in zip(*((r.forces, r.low, r.high) for r in readings), strict=True)
    )
    probable = [reading.error_probability for reading in readings]
    known = [each for each in probable if each is not None]
    if known:
        name, trusted, limit = "probability of a large error [-]", np.concatenate(known), LIKELY
    else:
        name, trusted, limit = "OOD score [-]", np.concatenate([r.ood_score for r in readings]), 1.0
    panels = [
        Panel(
            f"{sensor.name} [{sensor.unit}]",
            (Curve("estimate", number, values[:, i], low[:, i], high[:, i]),),
            group=sensor.unit,
        )
        for i, sensor in enumerate(schema.estimated)
    ]
    line = Curve("limit", number, np.full_like(number, limit), target=True)
    panels.append(Panel(name, (Curve("estimate", number, trusted.astype(float)), line)))
    return curves("picture, in the order given [-]", panels, columns=2)


def _panel(label: str, lines: Sequence[Curve]) -> Panel:
    return Panel(label, tuple(lines))
