"""The calibration of an actuator: what it must be commanded, in its own unit, for a load of the channel."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from exosight.errors import InputError
from exosight.rig.table import TableColumn, read_table
from exosight.rig.units import in_si
from exosight.system.schema import Channel
from exosight.system.system import System


@dataclass(frozen=True, eq=False)
class ActuatorCurve:
    """Commands of a named actuator against the loads that they make, linear in between.

    name, unit   of the actuator's command: pressure, kPa
    load         (points,)   strictly rising, 0 within [the channel's unit]
    command      (points,)   strictly rising or strictly falling [unit]

    Raises InputError for fewer than two points, or numbers that are not so.
    """

    name: str
    unit: str
    load: Float[np.ndarray, " points"]
    command: Float[np.ndarray, " points"]

    def __post_init__(self) -> None:
        if len(self.load) < 2 or len(self.load) != len(self.command):
            raise InputError(
                f"{self.name}: expected two points or more, each a command and a load, got {len(self.load)}"
            )
        if not (np.isfinite(self.load).all() and np.isfinite(self.command).all()):
            raise InputError(f"{self.name}: expected a command and a load in every row, got an empty one")
        steps = np.diff(self.command)
        wrong = np.flatnonzero((np.diff(self.load) <= 0) | (steps * steps[0] <= 0))
        if wrong.size:
            k = int(wrong[0])
            raise InputError(
                f"{self.name}: expected a load that rises, or falls, with every command, got "
                f"{self.load[k]:g} at {self.command[k]:g} {self.unit} and {self.load[k + 1]:g} at "
                f"{self.command[k + 1]:g} {self.unit}; average the readings of going up and down"
            )
        if not self.load[0] <= 0 <= self.load[-1]:
            raise InputError(
                f"{self.name}: expected the load 0 within the curve, as it is released to that, got "
                f"{self.load[0]:g} to {self.load[-1]:g}; add the command without load"
            )

    def at(self, load: float) -> float:
        """The command for a load within the curve [unit]; InputError for one beyond it."""
        if not self.load[0] <= load <= self.load[-1]:
            raise InputError(
                f"{self.name}: expected a load of {self.load[0]:g} to {self.load[-1]:g}, got {load:g}; "
                "calibrate further"
            )
        return float(np.interp(load, self.load, self.command))


def read_actuator_curve(path: Path, channel: Channel) -> ActuatorCurve:
    """A calibration (CSV): a column of commands, such as "pressure [kPa]", and one of loads, "u [N]".

    channel   that the loads are of, whose name heads their column

    Raises DataError and InputError, with one sentence, for a table that is none.
    """
    table = read_table(path)
    loads = table.find([channel.name.lower()])
    others = [column for column in table.columns if column is not loads]
    if loads is None or len(others) != 1:
        raise InputError(
            f'{path}: expected two columns, the command with its unit, like "pressure [kPa]", and the load '
            f"{channel.name} [{channel.unit}], got {', '.join(column.heading for column in table.columns)}"
        )
    (commands,) = others
    for column in (commands, loads):
        if column.unit is None:
            raise InputError(f"{path}: column {column.heading} has no unit; write it behind the name")
    assert commands.unit is not None
    try:
        load = _in_unit(loads, channel.unit)
        order = np.argsort(load, kind="stable")
        return ActuatorCurve(commands.name, commands.unit, load[order], commands.numbers[order])
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _in_unit(column: TableColumn, unit: str) -> Float[np.ndarray, " rows"]:
    (kind, size), (other, own) = in_si(column.unit or ""), in_si(unit)
    if kind != other:
        raise InputError(f"column {column.heading}: expected a load in {unit}, got {column.unit}")
    return size / own * column.numbers


def within_curve(system: System, channel: str, curve: ActuatorCurve) -> System:
    """The system with the range of a channel narrowed to that of the curve.

    Raises InputError if no load above 0 is left.
    """
    place = system.schema.channel_index(channel)
    actuator = system.actuators[place]
    own = actuator.channel
    low, high = max(own.low, float(curve.load[0])), min(own.high, float(curve.load[-1]))
    if not high > 0:
        raise InputError(
            f"{curve.name}: expected loads above 0 {own.unit} in the curve, as {own.name} is driven towards "
            f"its upper end, got {curve.load[0]:g} to {curve.load[-1]:g} {own.unit}"
        )
    drive = None if own.drive is None else min(own.drive, high)
    narrowed = replace(actuator, channel=replace(own, low=low, high=high, drive=drive))
    actuators = (*system.actuators[:place], narrowed, *system.actuators[place + 1 :])
    return replace(system, actuators=actuators)
