"""`exosight estimate --loads`: estimates of a network beside those refined by an identified model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from exosight.control.agreement import Agreement, agreement
from exosight.control.estimator import Reading
from exosight.errors import InputError
from exosight.evaluation.naming import common_unit, kind, row_name
from exosight.evaluation.tables import Cell, Column, Table
from exosight.files import read_file
from exosight.rig.identification.files import outline_of_system, read_commands
from exosight.rig.identification.refined import Refined, Refiner
from exosight.rig.table import read_table
from exosight.system.file import read_system_file
from exosight.system.schema import Schema
from exosight.vision.pictures import LARGEST_FILE, decode


@dataclass(frozen=True)
class Beside:
    """A model's readings of one picture beside a network's.

    refined     all of the model
    values      of the network's outputs, then their sums [their units]
    deviations  likewise
    agreement   of the outputs
    """

    refined: Refined
    names: tuple[str, ...]
    values: Float[np.ndarray, " readings"]
    deviations: Float[np.ndarray, " readings"]
    agreement: Agreement

    def as_json(self, schema: Schema) -> dict[str, Any]:
        """As JSON; keys name quantity and unit."""
        differences = dict(zip(self.agreement.names, self._pairs(), strict=True))
        rows = []
        for name, value, deviation in zip(self.names, self.values, self.deviations, strict=True):
            unit = schema.sensor(name).unit
            row: dict[str, Any] = {
                kind(schema): name,
                f"value_{unit}": round(float(value), 6),
                f"deviation_{unit}": round(float(deviation), 6),
            }
            if name in differences:
                row |= {
                    f"difference_{unit}": round(differences[name][0], 6),
                    f"difference_deviation_{unit}": round(differences[name][1], 6),
                }
            rows.append(row)
        return {
            "sensors": rows,
            "command": self.refined.command.tolist(),
            "outline_misfit_pixels": round(self.refined.misfit, 4),
            "disagreement_score": round(self.agreement.score, 3),
        }

    def table(self, schema: Schema, network: Mapping[str, float], caption: str) -> Table:
        """Both, their difference and its deviation.

        network   the network's outputs and sums, by name
        """
        unit = common_unit(schema)
        columns = (
            Column(kind(schema)),
            Column("network", unit, digits=3),
            Column("refined", unit, digits=3),
            Column("deviation", unit, digits=3),
            Column("difference", unit, digits=3),
            Column("its deviation", unit, digits=3),
        )
        pairs = dict(zip(self.agreement.names, self._pairs(), strict=True))
        rows: list[tuple[Cell, ...]] = []
        for name, value, deviation in zip(
            self.names, self.values.tolist(), self.deviations.tolist(), strict=True
        ):
            difference, own = pairs.get(name, (network[name] - value, None))
            rows.append((row_name(schema, name), network[name], value, deviation, difference, own))
        note = (
            f"the model explains the outline to {self.refined.misfit:.2f} pixels; disagreement score "
            f"{self.agreement.score:.2f}, agree up to 1"
        )
        return Table("refined", caption, columns, tuple(rows), note)

    def _pairs(self) -> list[tuple[float, float]]:
        return list(zip(self.agreement.difference.tolist(), self.agreement.deviation.tolist(), strict=True))


class Refinement:
    """An identified model, and the loads of pictures.

    system   system file
    loads    table
    masks    folder with a mask of each picture; None: outlines are found in the pictures
    images   the pictures
    schema   of the network
    sums     of its outputs that are shown too

    Raises DataError and InputError for files that do not fit each other.
    """

    def __init__(
        self,
        system: str,
        loads: Path,
        masks: Path | None,
        images: Sequence[Path],
        schema: Schema,
        sums: Sequence[str],
    ) -> None:
        self._refiner = Refiner(read_system_file(Path(system)))
        own = self._refiner.system.schema
        units = {sensor.name: sensor.unit for sensor in own.sensors}
        for sensor in schema.estimated:
            if units.get(sensor.name) != sensor.unit:
                raise InputError(
                    f"system: expected sensors that the network estimates, {', '.join(schema.outputs)}, got "
                    f"{', '.join(units)} in {system}; choose the network of this system with --model"
                )
        self._count = len(schema.outputs)
        self._names = (*schema.outputs, *(name for name in sums if name in units))
        self._places = [own.index(name) for name in self._names]
        commands = read_commands(read_table(loads), [str(path) for path in images], own)
        self._commands = dict(zip(images, commands, strict=True))
        self._masks = masks
        self._before: Refined | None = None

    def read(self, path: Path, reading: Reading, level: float) -> Beside:
        """A picture in its own size, which is that of the system file's camera.

        Raises DataError if it has another, or does not show the system; ConvergenceError without a pose.
        """
        place = path if self._masks is None else self._masks / path.name
        gray = decode(read_file(place, LARGEST_FILE, "expected a picture"), str(place)).gray
        outline = outline_of_system(gray, self._refiner.system, self._masks is not None, str(place))
        found = self._refiner.refine(outline, self._commands[path], self._before)
        self._before = found
        values, deviations = (of[self._places] for of in (found.readings, found.deviations))
        count = self._count
        agreed = agreement(self._names[:count], reading, level, values[:count], deviations[:count])
        return Beside(found, self._names, values, deviations, agreed)
