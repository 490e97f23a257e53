"""The system that the lab shows: its designs, the commands of its channels, and its network."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path

from exosight.control.estimator import OnnxEstimator, model_path
from exosight.errors import InputError
from exosight.exosuit.catalogue import PRESETS, find_system
from exosight.lab.designs import DesignControls, file_controls, key_of
from exosight.lab.pose_cache import CachedSystem, Drive, Grid, Move, PoseCache, grid_of
from exosight.lab.published_designs import published_controls
from exosight.lab.settings import CameraSettings, LoopSettings, PathSettings, View
from exosight.system.designs import DesignSet, FileDesigns
from exosight.system.schema import Schema, SensorSpec, network_difference

DEFAULT = "index"
"""The system that is shown if none is named."""
_START = 0.6  # share of its peak that the first channel starts at


@dataclass(frozen=True)
class LabSystem:
    """One system, and all that is remembered of its designs.

    name      as `--system` is given it
    designs   of the system
    controls  of these designs on the page
    grids     of its channels, in their order
    network   that reads pictures
    model     file of the network, if it is not the package's own
    refusal   why the network cannot read pictures of this system; None: it can
    """

    name: str
    designs: DesignSet
    controls: DesignControls
    grids: tuple[Grid, ...]
    network: OnnxEstimator
    model: Path | None
    refusal: str | None
    poses: PoseCache = field(default_factory=PoseCache)

    @property
    def schema(self) -> Schema:
        """Names and units of channels and sensors."""
        return self.controls.schema

    @property
    def start(self) -> View:
        """The nominal design, the first channel at 60 % of its peak."""
        first, *others = self.grids
        steps = round(_START * first.peak)
        return View(drive=((first.command(steps), *(0.0 for _ in others)),))

    def check(self, settings: View | PathSettings | LoopSettings) -> None:
        """Raises InputError, naming the entry, for settings that are not this system's."""
        view = settings if isinstance(settings, View) else settings.view
        self.controls.complete(view.design)
        self.moves(view)
        if isinstance(settings, View):
            return
        self.channel(settings.channel)
        self.sensor(settings.sensor)
        if isinstance(settings, LoopSettings):
            self.schema.weights(self.sensor(settings.sensor).name)
            if settings.measured == "network" and self.refusal is not None:
                raise InputError(f"measured: {self.refusal}")

    def channel(self, name: str | None) -> int:
        """Place of a channel among all, by default the first; InputError if there is none of this name."""
        return self.schema.channel_index(name)

    def sensor(self, name: str | None) -> SensorSpec:
        """A sensor, by default the one that control follows; InputError if there is none of this name."""
        return self.schema.sensor(self.schema.controlled if name is None else name)

    def moves(self, view: View) -> list[Move]:
        """The drive of a view, channel by channel.

        Raises InputError for another number of commands, or one that is not on its channel's grid.
        """
        moves: list[Move] = []
        for stop, commands in enumerate(view.drive):
            if len(commands) != len(self.grids):
                names = ", ".join(grid.channel.name for grid in self.grids)
                raise InputError(
                    f"drive.{stop}: expected a command for each channel ({names}), got {len(commands)}"
                )
            for channel, (grid, command) in enumerate(zip(self.grids, commands, strict=True)):
                moves.append((channel, _steps(grid, command, f"drive.{stop}.{grid.channel.name}")))
        return moves

    def stops(self, drive: Drive) -> tuple[tuple[float, ...], ...]:
        """The commands after each move of a drive; none at rest."""
        now, stops = [0] * len(self.grids), []
        for channel, steps in drive:
            now[channel] = steps
            stops.append(tuple(grid.command(at) for grid, at in zip(self.grids, now, strict=True)))
        return tuple(stops)

    def cached(self, view: View) -> CachedSystem:
        """The system of a view with all that is known of it."""
        values = self.controls.complete(view.design)
        return self.poses.get(key_of(values), lambda: CachedSystem(self.controls.build(values), self.grids))

    def is_light(self, view: View) -> bool:
        """Whether little is to be solved for a view: a move of a design that is remembered."""
        cached = self.poses.known(key_of(self.controls.complete(view.design)))
        return cached is not None and cached.is_near(self.moves(view))

    def command(self, view: View) -> str:
        """The command that opens the page with this view; with `--out FOLDER` it writes the view's files."""
        words = ["exosight", "lab"]
        words += [] if self.name == DEFAULT else ["--system", self.name]
        words += [] if self.model is None else ["--model", str(self.model)]
        changed = self.controls.changed(view.design)
        words += ["--vary", *changed] if changed else []
        if view.drive != self.start.drive:
            commands = [command for stop in view.drive for command in stop] or [0.0] * len(self.grids)
            words += ["--drive", *(f"{command:.10g}" for command in commands)]
        nominal = CameraSettings()
        for each in fields(CameraSettings):
            value = getattr(view.camera, each.name)
            if value != getattr(nominal, each.name):
                text = value if isinstance(value, str) else f"{value:.10g}"
                words += [f"--{each.name.replace('_', '-')}", text]
        return shlex.join(words)


def open_system(name: str = DEFAULT, model: Path | None = None) -> LabSystem:
    """The system of a preset or a file, with a network: the package's own by default.

    Raises InputError or DataError for a system or a network that cannot be used.
    """
    designs = find_system(name)
    controls = (
        file_controls(designs) if isinstance(designs, FileDesigns) else published_controls(PRESETS[name][0])
    )
    network = OnnxEstimator.load(model_path(model, name), alone=True)
    grids = tuple(grid_of(channel) for channel in controls.schema.channels)
    return LabSystem(name, designs, controls, grids, network, model, _refusal(network, controls.schema))


def stops_of(commands: Sequence[float], channels: int) -> tuple[tuple[float, ...], ...]:
    """Commands in a row, a command a channel for each stop; InputError if the last stop lacks some."""
    if len(commands) % channels:
        raise InputError(f"drive: expected {channels} commands a stop, got {len(commands)} commands")
    return tuple(tuple(commands[i : i + channels]) for i in range(0, len(commands), channels))


def _refusal(network: OnnxEstimator, schema: Schema) -> str | None:
    """Why a network cannot read pictures of a system."""
    other = network_difference(network.card.schema, schema)
    if other is None:
        return None
    return (
        f"no estimates: the network was trained for the system {network.card.schema.system}; {other}; "
        "give exosight lab another --model"
    )


def _steps(grid: Grid, command: float, place: str) -> int:
    """A command in steps; InputError if it is out of range, or between two steps."""
    unit, low, high = grid.channel.unit, grid.command(grid.bottom), grid.command(grid.top)
    near = 1e-6 * grid.step
    if not low - near <= command <= high + near:
        raise InputError(f"{place}: expected {low:g} to {high:g} {unit}, got {command:g}")
    steps = round(command / grid.step)
    if abs(command - steps * grid.step) > near:
        raise InputError(f"{place}: expected multiples of {grid.step:g} {unit}, got {command:g}")
    return steps
