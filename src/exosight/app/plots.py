"""`--plot FILE`: what a command found as one figure."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from exosight.app.console import say
from exosight.arrays import AnyArray
from exosight.control.estimator import Reading
from exosight.control.paths import ControllerConfig
from exosight.control.recording import Recording
from exosight.control.replay import Replay
from exosight.control.trials import Trial
from exosight.evaluation.figures import Curve, Panel, curves, to_bytes
from exosight.files import write_new_file
from exosight.system.schema import Schema

TIME = "time [s]"


def write_plot(figure: Figure, path: Path) -> None:
    """Write a Matplotlib figure to a new PNG, PDF or SVG file, see `exosight.app.output.check_plot`."""
    write_new_file(path, to_bytes(figure, path.suffix[1:]))
    say(f"wrote {path}")


def plot_path(
    schema: Schema,
    commands: Float[np.ndarray, "loads channels"],
    readings: Float[AnyArray, "loads sensors"],
    lost: Sequence[bool],
) -> Figure:
    """The readings of a system over its command; of several channels over the number of the load.

    lost   loads without an equilibrium, which are left out
    """
    if len(schema.channels) == 1:
        (channel,) = schema.channels
        x, label = commands[:, 0], f"{channel.name} [{channel.unit}]"
    else:
        x, label = np.arange(1.0, len(commands) + 1), "number of the load [-]"
    order = np.argsort(x)
    y = np.where(np.asarray(lost)[:, None], np.nan, np.asarray(readings, float))
    found: dict[str, list[Curve]] = {}
    for column, sensor in enumerate(schema.sensors):
        curve = Curve(sensor.name, x[order], y[order, column])
        found.setdefault(f"{sensor.quantity} [{sensor.unit}]", []).append(curve)
    return curves(label, [_panel(name, lines) for name, lines in found.items()])


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
            record, name = trial.record, f"{trial.record.target[0]:g} {sensor.unit}, K_P = {trial.gain:g}"
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
    """Each estimated sensor with its interval, and the OOD score, over the number of the picture."""
    number = np.arange(1.0, len(readings) + 1)
    values, low, high = (
        np.concatenate(parts).astype(float)
        for parts in zip(*((r.forces, r.low, r.high) for r in readings), strict=True)
    )
    score = np.concatenate([reading.ood_score for reading in readings]).astype(float)
    panels = [
        Panel(
            f"{sensor.name} [{sensor.unit}]",
            (Curve("estimate", number, values[:, i], low[:, i], high[:, i]),),
            group=sensor.unit,
        )
        for i, sensor in enumerate(schema.estimated)
    ]
    limit = Curve("limit", number, np.ones_like(number), target=True)
    panels.append(Panel("OOD score [-]", (Curve("score", number, score), limit)))
    return curves("picture, in the order given [-]", panels, columns=2)


def _panel(label: str, lines: Sequence[Curve]) -> Panel:
    return Panel(label, tuple(lines))
