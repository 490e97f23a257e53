"""Names and units in tables and figures, by the schema of a system."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from exosight.system.schema import Schema


def sums(schema: Schema) -> tuple[str, ...]:
    """Names of the sensors that are sums of estimated ones, such as a net force."""
    return tuple(
        sensor.name for sensor in schema.sensors if sensor.parts and sensor.name in schema.controllable
    )


def contacts(schema: Schema) -> tuple[str, ...]:
    """Names of all contact forces, estimated or not."""
    return tuple(sensor.name for sensor in schema.sensors if sensor.quantity == "contact force")


def with_sums(schema: Schema, values: Float[np.ndarray, "frames outputs"]) -> Float[np.ndarray, "frames all"]:
    """The estimated sensors, and behind them the `sums` [their units]."""
    return np.column_stack([values, *((values * schema.weights(name)).sum(axis=1) for name in sums(schema))])


def kind(schema: Schema) -> str:
    """What one output is called: a contact if all are contact forces, else a sensor."""
    return "contact" if forces_only(schema) else "sensor"


def forces_only(schema: Schema) -> bool:
    """Whether all outputs are contact forces."""
    return all(sensor.quantity == "contact force" for sensor in schema.estimated)


def common_unit(schema: Schema) -> str:
    """The unit of all outputs; empty where they differ."""
    units = {sensor.unit for sensor in schema.estimated}
    return units.pop() if len(units) == 1 else ""


def row_name(schema: Schema, name: str) -> str:
    """A sensor's name, with its unit where the outputs have several."""
    return name if common_unit(schema) else f"{name} [{schema.sensor(name).unit}]"


def span(names: Sequence[str]) -> str:
    """Names in short: "C1…C7", "P1 and P2"."""
    if len(names) < 3:
        return " and ".join(names)
    return f"{names[0]}…{names[-1]}"
