"""A view as files, and the command that makes it again."""

import shlex
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import pydantic

from exosight.exosuit.finger import SPHERES
from exosight.files import as_csv, write_new_file
from exosight.lab.pose_cache import PoseCache
from exosight.lab.settings import View
from exosight.lab.views import Seen, exosuit_of, path_of, png_of, see


def command_of(view: View) -> str:
    """The command that opens the page with this view; with `--out FOLDER` it writes the view's files."""
    words = ["exosight", "lab"]
    start = View()
    for field in fields(View):
        value = getattr(view, field.name)
        if value != getattr(start, field.name):
            values = value if isinstance(value, tuple) else (value,)
            words += [f"--{field.name.replace('_', '-')}", *(_word(each) for each in values)]
    return shlex.join(words)


def _word(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.10g}"


def forces_csv(seen: Seen) -> str:
    """True and estimated forces, a row a contact and one for F_net; empty where the network says nothing."""
    header = ("contact", "true [N]", "estimated [N]", "from [N]", "to [N]", "contact probability")
    rows: list[Sequence[Any]] = [(SPHERES[0], float(seen.pose.forces[0]), "", "", "", "")]
    reading = seen.reading
    for i, name in enumerate(SPHERES[1:]):
        estimated = (
            float(each[0, i]) for each in (reading.forces, reading.low, reading.high, reading.contact)
        )
        rows.append((name, float(seen.pose.forces[i + 1]), *estimated))
    rows.append(("F_net", float(seen.pose.net_force), float(reading.forces.sum()), "", "", ""))
    return as_csv(header, rows)


def path_csv(path: dict[str, Any]) -> str:
    """F_net while u rises and while it falls, a row an actuation."""
    header = ("u [N]", "F_net loading [N]", "F_net unloading [N]")
    return as_csv(header, list(zip(path["u"], path["loading"], path["unloading"], strict=True)))


def write_view(view: View, folder: Path) -> None:
    """Write picture, forces, path and settings of a view into an empty folder."""
    poses = PoseCache()
    seen = see(view, poses)
    write_new_file(folder / "picture.png", png_of(seen.image))
    write_new_file(folder / "forces.csv", forces_csv(seen).encode())
    write_new_file(folder / "path.csv", path_csv(path_of(poses.get(exosuit_of(view)))).encode())
    write_new_file(folder / "view.json", pydantic.TypeAdapter(View).dump_json(view, indent=1) + b"\n")
