"""What was measured on a rig: outlines in pictures at known commands, and perhaps forces."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from exosight.errors import InputError
from exosight.rig.identification.outlines import Outline

FORCE_ERROR = 0.01
"""Standard deviation of a reading, as a share of the largest one of its sensor."""


@dataclass(frozen=True)
class Measurements:
    """Pictures of one rig, in the order in which its commands were reached.

    commands    (pictures, channels)   in the channels' units, the first approached from rest
    outlines    one a picture
    readings    of sensors, by their names: (pictures,), NaN where there is none [each in its unit]
    errors      standard deviation of a reading of each of these sensors [in its unit]; FORCE_ERROR by default

    Raises InputError for lengths that differ, or commands that are not finite.
    """

    commands: Float[np.ndarray, "pictures channels"]
    outlines: tuple[Outline, ...]
    readings: dict[str, Float[np.ndarray, " pictures"]] = field(default_factory=dict)
    errors: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = len(self.outlines)
        lengths = [len(self.commands), *map(len, self.readings.values())]
        if set(lengths) != {count}:
            raise InputError(f"loads: expected one row a picture, {count}, got {lengths}")
        if not np.all(np.isfinite(self.commands)):
            raise InputError("loads: expected finite commands, got one that is not")

    def check_identifiable(self) -> None:
        """Raise InputError for fewer than two pictures, or one command in all."""
        if len(self.outlines) < 2:
            raise InputError(
                f"pictures: expected at least two, at different commands, got {len(self.outlines)}; one "
                "picture does not tell stiffness from load"
            )
        if len(np.unique(self.commands, axis=0)) < 2:
            raise InputError("loads: expected pictures at two commands or more, got one command in all")

    def error(self, sensor: str) -> float:
        """Standard deviation of a reading of a sensor."""
        largest = float(np.nanmax(np.abs(self.readings[sensor])))
        return self.errors.get(sensor, max(FORCE_ERROR * largest, 1e-4))
