"""What a network estimates, and what it learns beside that, by the schema of its system; without PyTorch."""

import numpy as np
from jaxtyping import Bool, Float, Float32

from exosight.system.schema import Schema


def nonnegative(schema: Schema) -> Bool[np.ndarray, " outputs"]:
    """Which outputs are magnitudes of forces: never below 0, and 0 where there is no contact."""
    return np.array([not sensor.signed for sensor in schema.estimated], dtype=bool)


def auxiliary_units(schema: Schema) -> tuple[str, ...]:
    """Units of `auxiliary_values`."""
    angles, sums = _auxiliary_sensors(schema)
    return (
        *(schema.sensor(name).unit for name in angles),
        *(channel.unit for channel in schema.channels),
        *(schema.sensor(name).unit for name in sums),
    )


def auxiliary_values(
    schema: Schema,
    sensors: Float32[np.ndarray, "frames sensors"],
    commands: Float32[np.ndarray, "frames channels"],
) -> Float32[np.ndarray, "frames auxiliary"]:
    """What a light network learns beside its outputs, as it helps to find them.

    These are the joint angles that are not estimated [rad], the commands, and the sums of estimated sensors.
    """
    angles, sums = _auxiliary_sensors(schema)
    labels = sensors[:, schema.output_indices()]
    return np.column_stack(
        [
            sensors[:, [schema.index(name) for name in angles]],
            commands,
            *((labels * schema.weights(name).astype(np.float32)).sum(axis=1) for name in sums),
        ]
    ).astype(np.float32)


def command_scale(schema: Schema) -> Float[np.ndarray, " channels"]:
    """A quarter of each channel's peak [its unit]: about how far its commands spread over a path."""
    return np.array([abs(channel.peak) / 4 for channel in schema.channels])


def _auxiliary_sensors(schema: Schema) -> tuple[list[str], list[str]]:
    """Names of joint angles that are not estimated, and of sums that follow from what is."""
    angles = [s.name for s in schema.sensors if s.quantity == "joint angle" and not s.estimated]
    sums = [s.name for s in schema.sensors if s.parts and s.name in schema.controllable]
    return angles, sums
