"""A view as files."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pydantic

from exosight.files import as_csv, write_new_file
from exosight.lab.estimates import reading_of
from exosight.lab.pictures import png_of
from exosight.lab.settings import PathSettings, View
from exosight.lab.system import LabSystem
from exosight.lab.views import ViewResult, compute_view, path_answer, path_of


def readings_csv(seen: ViewResult, lab: LabSystem) -> str:
    """True and estimated readings, a row a sensor; empty where the network says nothing."""
    header = ("sensor", "unit", "true", "estimated", "from", "to", "contact probability")
    estimates = {} if seen.reading is None else reading_of(seen.reading, lab.schema)["estimates"]
    rows: list[Sequence[Any]] = []
    for sensor, value in zip(lab.schema.sensors, seen.observation.readings, strict=True):
        own = estimates.get(sensor.name, {})
        estimated = (own.get(key, "") for key in ("value", "low", "high", "contact"))
        rows.append((sensor.name, sensor.unit, round(float(value), 7), *estimated))
    return as_csv(header, rows)


def pose_csv(seen: ViewResult) -> str:
    """Centreline and radius of every tube, a row a node, from its base to its tip; positions in the world."""
    rows: list[Sequence[Any]] = []
    for tube in seen.system.tubes:
        axis, radius = seen.observation.axes[tube.name], np.asarray(tube.radius)
        for node, (place, size) in enumerate(zip(axis.tolist(), radius.tolist(), strict=True)):
            rows.append((tube.name, node, *place, size))
    return as_csv(("tube", "node", "x [m]", "y [m]", "z [m]", "radius [m]"), rows)


VIEW_FILES: dict[str, Callable[[ViewResult, LabSystem], bytes]] = {
    "picture.png": lambda seen, lab: png_of(seen.image),
    "pose.csv": lambda seen, lab: pose_csv(seen).encode(),
    "readings.csv": lambda seen, lab: readings_csv(seen, lab).encode(),
}
"""What can be saved of a view, by the name of the file."""


def path_csv(path: dict[str, Any], lab: LabSystem) -> str:
    """A sensor while a channel is driven to its peak and back, a row a command."""
    channel, sensor = lab.grids[lab.channel(path["channel"])].channel, lab.sensor(path["sensor"])
    header = (f"{channel.name} [{channel.unit}]", f"{sensor.name} [{sensor.unit}]", "way")
    rows = [(*point, way) for way in ("loading", "unloading") for point in path[way]]
    return as_csv(header, rows)


def write_view(view: View, lab: LabSystem, folder: Path) -> None:
    """Write picture, pose, readings, path and settings of a view into an empty folder."""
    seen = compute_view(view, lab)
    settings = PathSettings(view)
    path = path_answer(settings, path_of(settings, lab), lab.cached(view), lab)
    for name, content in VIEW_FILES.items():
        write_new_file(folder / name, content(seen, lab))
    write_new_file(folder / "path.csv", path_csv(path, lab).encode())
    write_new_file(folder / "view.json", pydantic.TypeAdapter(View).dump_json(view, indent=1) + b"\n")
