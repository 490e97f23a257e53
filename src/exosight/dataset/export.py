"""Datasets and simulated paths in formats that other programs read: .mat, .npz, CSV with PNG."""

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from exosight.dataset.frames import QUANTITIES, Columns, Frames
from exosight.dataset.manifest import MANIFEST, Manifest, read_manifest
from exosight.dataset.matlab import to_matlab, write_mat
from exosight.dataset.store import read_frames, read_variation
from exosight.errors import DataError, InputError
from exosight.files import new_file, read_file
from exosight.system.schema import Channel, SensorSpec

LARGEST_PATH = 256 * 2**20  # [bytes]; a path of 1000 loads takes 1 MiB

Values = dict[str, Any]


def export_dataset(
    folder: Path,
    out: Path,
    progress: Callable[[int, int], None] = lambda done, total: None,
    with_poses: bool = False,
) -> int:
    """Write a complete dataset in another format, and return its number of frames.

    out        *.mat, *.npz, or an existing, empty folder for frames.csv and images/*.png
    progress   called with the pictures written and their total, where there are pictures
    with_poses centrelines and radii of all bodies too, see `exosight.dataset.poses`

    Raises DataError if the dataset is damaged or `out` cannot be written, InputError for another format.
    """
    if not out.is_dir():
        check_format(out, (".mat", ".npz"))
    manifest, frames, variation = read_manifest(folder), read_frames(folder), read_variation(folder)
    shapes: dict[str, np.ndarray] = {}
    if with_poses:
        from exosight.dataset.poses import poses  # only now: JAX takes a second to import

        shapes = poses(manifest, frames)
    drawn = {name.replace(".", "_"): values for name, values in variation.items()}
    about: Values = {
        "families": list(manifest.families),
        "scenarios": list(manifest.scenarios),
        "sensor_names": [sensor.name for sensor in manifest.schema.sensors],
        "sensor_units": [sensor.unit for sensor in manifest.schema.sensors],
        "channel_names": [channel.name for channel in manifest.schema.channels],
        "channel_units": [channel.unit for channel in manifest.schema.channels],
        "manifest": (folder / MANIFEST).read_text(encoding="utf-8"),
    }
    if out.is_dir():
        _write_folder(out, frames, manifest, variation, about["manifest"], progress)
        _write_poses(out, shapes)
    elif out.suffix == ".mat":
        write_mat(out, {**to_matlab(frames), **shapes, **({"variation": drawn} if drawn else {}), **about})
    else:
        arrays = {name: getattr(frames, name) for name in QUANTITIES}
        _write_npz(
            out, {**arrays, **shapes, **{f"variation_{name}": v for name, v in drawn.items()}, **about}
        )
    return len(frames)


def export_path(source: Path, out: Path) -> int:
    """Write what `exosight simulate --json` found in another format, and return its number of loads.

    out   *.mat, *.npz or *.csv, a row a load

    Raises DataError if the file is not such a path or `out` cannot be written, InputError for another format.
    """
    check_format(out, (".mat", ".npz", ".csv"))
    about, columns = read_path(source)
    loads = len(columns["u"])
    if out.suffix == ".mat":
        write_mat(out, {**columns, **about})
    elif out.suffix == ".npz":
        _write_npz(out, {**columns, **about})
    else:
        with new_file(out) as part, part.open("w", newline="", encoding="utf-8") as file:
            _write_rows(file, _flat(columns), loads)
    return loads


def read_path(source: Path) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """A simulated path: exosuit and units as JSON texts, and its numbers by name, one row a load.

    Raises DataError if the file is missing or holds no path.
    """
    try:
        found = json.loads(read_file(source, LARGEST_PATH, "expected a simulated path"))
        records = found["path"]
        names = list(records[0])
        columns = {name: np.asarray([record[name] for record in records]) for name in names}
        about = {name: json.dumps(found[name]) for name in ("exosuit", "units")}
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, RecursionError) as error:
        raise DataError(
            f"{source}: no simulated path; make one with exosight simulate --json FILE"
        ) from error
    for name, values in columns.items():
        if values.dtype.kind not in "fib" or (values.dtype.kind == "f" and not np.all(np.isfinite(values))):
            raise DataError(f"{source}: {name} holds something else than finite numbers")
    return about, columns


def check_format(out: Path, formats: tuple[str, ...]) -> None:
    """Raise InputError unless the name ends as one of the formats do; "" is a folder."""
    if out.suffix not in formats:
        known = ", ".join(each or "a folder" for each in formats)
        raise InputError(f"out: expected {known}, got {out.name!r}; choose another ending")


def _write_npz(out: Path, values: Values) -> None:
    with new_file(out) as part, part.open("wb") as file:
        np.savez_compressed(file, **values, allow_pickle=False)


def _write_folder(
    out: Path,
    frames: Frames,
    manifest: Manifest,
    variation: Columns,
    text: str,
    progress: Callable[[int, int], None],
) -> None:
    images = out / "images"
    images.mkdir()
    names = [f"images/frame_{number:06d}.png" for number in range(len(frames))]
    for number, (name, image) in enumerate(zip(names, frames.images, strict=True)):
        # Not by OpenCV, which is silent about a full disk.
        (out / name).write_bytes(cv2.imencode(".png", image)[1].tobytes())
        progress(number + 1, len(frames))
    columns: dict[str, Any] = {
        "image": names,
        **_named("command", manifest.schema.channels, frames.commands),
        **_named("sensor", manifest.schema.sensors, frames.sensors),
        "design": frames.design,
        "family": [manifest.families[i] for i in frames.family],
        "scenario": [manifest.scenarios[i] for i in frames.scenario],
        "step": frames.step,
        **{f"q{i}": values for i, values in enumerate(frames.pose.T)},
        **variation,
    }
    with (out / "frames.csv").open("w", newline="", encoding="utf-8") as file:
        _write_rows(file, columns, len(frames))
    (out / MANIFEST).write_text(text, encoding="utf-8")


def _write_poses(out: Path, shapes: Mapping[str, np.ndarray]) -> None:
    """A table of every body: a row a node of a frame."""
    for name in (key.removeprefix("axis_") for key in shapes if key.startswith("axis_")):
        axis, radius = shapes[f"axis_{name}"], shapes[f"radius_{name}"]
        frame, node = (index.ravel() for index in np.indices(radius.shape))
        x, y, z = axis.reshape(-1, 3).T
        columns = {"frame": frame, "node": node, "x_m": x, "y_m": y, "z_m": z, "radius_m": radius.ravel()}
        with (out / f"pose_{name}.csv").open("w", newline="", encoding="utf-8") as file:
            _write_rows(file, columns, radius.size)


def _named(
    kind: str, entries: Sequence[Channel] | Sequence[SensorSpec], values: np.ndarray
) -> dict[str, np.ndarray]:
    """Columns by kind, name and unit, such as sensor_F_net_N or sensor_row_0_N_per_m; of a unit's other
    characters none is kept.
    """
    units = [
        "".join(c for c in entry.unit.replace("/", "_per_") if c.isalnum() or c == "_") for entry in entries
    ]
    names = ["_".join(filter(None, (kind, e.name, unit))) for e, unit in zip(entries, units, strict=True)]
    return dict(zip(names, values.T, strict=True))


def _write_rows(file: Any, columns: dict[str, Any], rows: int) -> None:
    writer = csv.writer(file)
    writer.writerow(columns)
    writer.writerows([_cell(values[row]) for values in columns.values()] for row in range(rows))


def _cell(value: Any) -> Any:
    """Numbers as the shortest text that reads back as the same number of their own type."""
    return str(value) if isinstance(value, np.generic) else value


def _flat(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """One column a number: `forces` becomes forces_0, forces_1 …, an axis axis_0_0, axis_0_1 …"""
    return {
        "_".join([name, *map(str, place)]): values[:, *place]
        for name, values in columns.items()
        for place in np.ndindex(values.shape[1:])
    }
