"""Actuators of a description: a channel in the file's units, and the energy that its command acts by."""

import numpy as np
from jaxtyping import Float

from exosight.arrays import floats
from exosight.errors import InputError
from exosight.mechanics import JointTorque, PressureLine
from exosight.mechanics.term import Term
from exosight.system.build_bodies import check_joint, rod_points, rod_profile
from exosight.system.description import ActuatorTable, Description, RodTable
from exosight.system.faults import at_place
from exosight.system.schema import Channel
from exosight.system.system import Actuator
from exosight.system.units import FORCE, TORQUE, split_quantity
from exosight.validation import check_name

LARGEST_LOAD = 1e6  # [N or N m]
STEEPEST = 1e3
"""Largest slope of a line along its rod [-]; a formula such as X**0.5 has an infinite one at X = 0."""


def build_actuators(description: Description) -> tuple[Actuator, ...]:
    """An actuator a channel, in the file's order.

    Raises InputError for a command whose unit or gain is not clear, or a body that cannot be actuated so.
    """
    return tuple(
        at_place(f"actuators.{name}", _actuator, description, name, table, place)
        for place, (name, table) in enumerate(description.actuators.items())
    )


def _actuator(description: Description, name: str, table: ActuatorTable, place: int) -> Actuator:
    channel, gain = _channel(name, table)
    if not abs(gain) * max(-channel.low, channel.high) <= LARGEST_LOAD:
        raise InputError(f"range: expected loads of at most {LARGEST_LOAD:g} N or N m, got {table.range}")
    torque = table.type == "joint_torque"
    term = _torque(description, table, place) if torque else _line(description, table, place)
    return Actuator(channel, term, floats(gain))


def _channel(name: str, table: ActuatorTable) -> tuple[Channel, float]:
    """The channel, and the load a unit of its command.

    A command in a unit of force (or torque) becomes one in N (or N m); in any other unit it stays as it is
    and needs a gain.
    """
    ends = [at_place("range", split_quantity, text, "4 N") for text in table.range]
    (low, unit), (high, other) = ends
    if unit != other:
        raise InputError(f"range: expected both ends in one unit, got {unit} and {other}")
    kind = TORQUE if table.type == "joint_torque" else FORCE
    natural = next(iter(kind.units))
    sign = -1.0 if table.type == "cable" else 1.0
    if unit in kind.units:
        if table.gain is not None:
            raise InputError(f"gain: a command in {unit} needs none; leave it out")
        scale, gain, shown = kind.units[unit], sign, natural
    else:
        scale, gain, shown = 1.0, sign * _gain(table.gain, unit, natural), unit
    rate, drive = _command(table, "rate", f"{unit}/s"), _command(table, "drive", unit)
    channel = Channel(
        name,
        shown,
        low * scale,
        high * scale,
        None if rate is None else rate * scale,
        None if drive is None else drive * scale,
    )
    return channel, gain


def _command(table: ActuatorTable, entry: str, unit: str) -> float | None:
    """The number of `rate` or `drive`, which stands in the unit of the range."""
    text: str | None = getattr(table, entry)
    if text is None:
        return None
    value, found = at_place(entry, split_quantity, text, f"10 {unit}")
    if found.replace(" ", "") != unit.replace(" ", ""):
        raise InputError(f"{entry}: expected it in {unit}, as the range is, got {text!r}")
    return value


def _gain(text: str | None, unit: str, natural: str) -> float:
    example = f"0.05 {natural}/{unit}"
    if text is None:
        raise InputError(f"gain: expected what a command in {unit} does, like {example!r}, got none")
    value, per = at_place("gain", split_quantity, text, example)
    if per.replace(" ", "") != f"{natural}/{unit}".replace(" ", ""):
        raise InputError(f"gain: expected it in {natural}/{unit}, got {text!r}")
    if value == 0:
        raise InputError("gain: expected another number than 0")
    return value


def _torque(description: Description, table: ActuatorTable, place: int) -> Term:
    check_joint(description, table.body, table.coordinate)
    return JointTorque(table.body, place, table.coordinate)


def _line(description: Description, table: ActuatorTable, place: int) -> Term:
    """The line at angle + 2π turns X around the rod, on its surface or at a constant offset."""
    rods = description.rods
    check_name("body", table.body, rods)
    rod = rods[table.body]
    x = rod_points(rod).points
    distance, growth = _distance(rod, table, x)
    turn = 2 * np.pi * table.turns
    angle = turn * x + table.angle
    across = np.stack([np.zeros(len(x)), np.cos(angle), np.sin(angle)], axis=1)
    ahead = np.stack([np.zeros(len(x)), -np.sin(angle), np.cos(angle)], axis=1)
    slope = (growth[:, None] * across + (turn * distance)[:, None] * ahead) / rod.length
    if not np.all(np.abs(slope) <= STEEPEST):
        worst = x[int(np.argmax(np.abs(slope).max(axis=1)))]
        raise InputError(
            f"offset: the line would run along the surface of rods.{table.body}, which is too steep at "
            f"X = {worst:.3f}; give the line an offset from the axis"
        )
    return PressureLine(rod=table.body, channel=place, offset=distance[:, None] * across, slope=slope)


def _distance(
    rod: RodTable, table: ActuatorTable, x: Float[np.ndarray, " points"]
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """How far a line is from its rod's axis [m], and the derivative of that by X [m]."""
    if table.offset is not None:
        return np.full(len(x), table.offset), np.zeros(len(x))
    profile = rod_profile(rod)
    return profile.value(x), profile.slope(x)
