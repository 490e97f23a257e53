"""The manifest of a dataset: what is in the folder, how it was made, and the checksum of every chunk.

It is written last, so a folder with a manifest is a complete dataset.
"""

import hashlib
import json
import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, JsonValue, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from exosight import __version__
from exosight.dataset.frames import QUANTITIES, row_shapes
from exosight.errors import DataError, InputError
from exosight.files import check_format, read_file, write_new_file
from exosight.system.camera import Camera
from exosight.system.design import Design
from exosight.system.schema import Schema
from exosight.validation import CONFIG, SystemName, first_fault

FORMAT = 2
"""Version of the layout on disk; a reader takes this one alone."""
JOB = "job.json"
MANIFEST = "manifest.json"
LARGEST_MANIFEST = 64 * 2**20  # [bytes]; 1375 designs take 0.5 MiB
LARGEST_FRAMES = 64 * 2**30  # [bytes] all images and poses in memory; the published dataset takes 1.1 GiB

Count = Annotated[int, Field(ge=0, le=100_000_000)]


@dataclass(frozen=True, config=CONFIG)
class ChunkEntry:
    """One chunk file of a dataset."""

    file: Annotated[str, Field(pattern=r"^chunk_[0-9]{4,8}\.h5$")]
    """Name within the folder; the pattern keeps it there."""
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    """Checksum of the file."""
    bytes: Annotated[int, Field(ge=1)]
    """Size of the file [bytes]."""
    frames: Annotated[int, Field(ge=1, le=100_000_000)]
    """Frames in the file."""
    designs: tuple[Count, ...]
    """Numbers of the designs whose frames are in the file."""


@dataclass(frozen=True, config=CONFIG)
class Manifest:
    """What a dataset holds and how it was made; `new_manifest` fills in what follows from the package."""

    format: int
    """Version of the layout on disk."""
    exosight_version: str
    """Version of the package that wrote it."""
    seed: Annotated[int, Field(ge=0)]
    """Seed of everything random in it; of measured frames, a number that follows from their readings."""
    config: dict[str, JsonValue]
    """The configuration that makes it again, of `exosight generate` or `exosight import`."""
    system: SystemName
    """Name of the system."""
    schema: Schema
    """Names, units and ranges of its channels, sensors and cameras."""
    description: dict[str, JsonValue] | None
    """Entries of its system file; None: a preset of this package, or a system that was measured."""
    camera: Camera | None
    """Camera of every image: the first of the schema; None: a real one, of which only the size is known."""
    dofs: Annotated[int, Field(ge=0, le=10_000)]
    """Generalised coordinates of a pose; 0 where poses are unknown."""
    families: tuple[str, ...]
    """Names that the frames' `family` counts, from 0."""
    scenarios: tuple[str, ...]
    """Names that the frames' `scenario` counts, from 0."""
    quantities: dict[str, dict[str, str]]
    """Type, unit and meaning of every array."""
    designs: tuple[Design, ...]
    """Every design asked for; of measured frames, every sequence."""
    chunks: tuple[ChunkEntry, ...]
    """The files with the frames."""
    dropped: dict[str, Count]
    """Frames left out, by cause."""

    @property
    def measured(self) -> bool:
        """Whether pictures and readings are of a real system."""
        return self.camera is None

    @property
    def frames(self) -> int:
        """Frames in all chunks."""
        return sum(chunk.frames for chunk in self.chunks)


_ADAPTER = TypeAdapter(Manifest)


def new_manifest(**entries: Any) -> Manifest:
    """The manifest of frames that this version of the package has made.

    entries   all of `Manifest` but format, exosight_version and quantities

    Raises InputError naming the first entry that does not fit.
    """
    quantities = {
        name: {"type": np.dtype(quantity.dtype).name, "unit": quantity.unit, "meaning": quantity.meaning}
        for name, quantity in QUANTITIES.items()
    }
    try:
        # Tuples become lists, as on disk.
        config = json.loads(json.dumps(entries.pop("config"), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise InputError(f"manifest: config must hold JSON values ({error})") from error
    chunks = sorted(entries.pop("chunks"), key=lambda chunk: chunk.file)
    try:
        return Manifest(
            format=FORMAT,
            chunks=tuple(chunks),
            exosight_version=__version__,
            quantities=quantities,
            config=config,
            **entries,
        )
    except ValidationError as error:
        raise InputError(f"manifest: {first_fault(error)}") from error


def dataset_identity(manifest: Manifest) -> dict[str, Any]:
    """Identifies a dataset, as JSON values: what it was made from, and how many frames remain.

    Not the checksums of its files: those change with the processor and the libraries that made them.
    """
    values = _ADAPTER.dump_python(manifest, mode="json")
    made = {
        name: values[name]
        for name in ("seed", "config", "system", "schema", "description", "camera", "designs", "dropped")
    }
    made["frames"] = manifest.frames
    return {
        "format": manifest.format,
        "sha256": hashlib.sha256(json.dumps(made, sort_keys=True).encode()).hexdigest(),
        "seed": manifest.seed,
        "frames": manifest.frames,
        "designs": len(manifest.designs),
        "camera": values["camera"],
        **({"crop": values["config"]["taken"]} if "taken" in values["config"] else {}),
    }


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Complete a dataset: write its manifest, after all its chunks.

    Raises DataError if a chunk is missing or has another size, if there is a manifest already, or if the
    file cannot be written; InputError if the manifest contradicts itself.
    """
    fault = _find_contradiction(manifest)
    if fault:
        raise InputError(f"manifest: {fault}")
    for chunk in manifest.chunks:
        check_size(folder / chunk.file, chunk)
    values = _ADAPTER.dump_python(manifest, mode="json")
    write_new_file(folder / MANIFEST, json.dumps(values, indent=1).encode())


def read_manifest(folder: Path) -> Manifest:
    """The manifest of a complete dataset.

    Raises DataError if the folder is missing, holds no or an incomplete dataset, or if its manifest is
    damaged, of another format or contradicts itself.
    """
    path = folder / MANIFEST
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder; expected a dataset")
    if not path.is_file():
        if (folder / JOB).exists() or any(folder.glob("chunk_*.h5")):
            raise DataError(
                f"{folder}: incomplete dataset, it has no {MANIFEST}; "
                "go on with it: the command that began it, with the same options and --resume"
            )
        raise DataError(f"{folder}: not a dataset, it has no {MANIFEST}")
    content = read_file(path, LARGEST_MANIFEST, "expected a dataset's manifest")
    try:
        values = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path}: truncated or damaged, it is not JSON ({error})") from error
    found = values.get("format") if isinstance(values, dict) else None
    check_format(path, "dataset", found, FORMAT, "generate it again with the options in its config")
    try:
        manifest = _ADAPTER.validate_json(content, strict=True)
    except ValidationError as error:
        raise DataError(f"{path}: damaged manifest, {first_fault(error)}") from error
    fault = _find_contradiction(manifest)
    if fault:
        raise DataError(f"{path}: damaged manifest, {fault}")
    return manifest


def check_size(path: Path, chunk: ChunkEntry) -> None:
    """Raise DataError unless a chunk's file is there with the size that was written."""
    if not path.is_file():
        raise DataError(f"{path}: missing, the manifest lists it")
    size = path.stat().st_size
    if size != chunk.bytes:
        raise DataError(f"{path}: truncated or altered, expected {chunk.bytes} bytes, got {size}")


def _find_contradiction(manifest: Manifest) -> str | None:
    camera, view = manifest.camera, manifest.schema.cameras[0]
    if camera and (camera.width, camera.height) != (view.width, view.height):
        return f"its camera is not that of its schema, {view.width}×{view.height} pixels"
    if manifest.system != manifest.schema.system:
        return f"its system {manifest.system} is not that of its schema, {manifest.schema.system}"
    if not manifest.chunks:
        return "it lists no chunks"
    if len({chunk.file for chunk in manifest.chunks}) < len(manifest.chunks):
        return "it lists a chunk twice"
    rows = row_shapes(manifest.schema, manifest.dofs)
    sizes = {
        name: math.prod(rows.get(name, ())) * np.dtype(each.dtype).itemsize
        for name, each in QUANTITIES.items()
    }
    numbers = sum(sizes.values()) - sizes["images"]  # all that a frame stores but for its image is not packed
    for chunk in manifest.chunks:
        if chunk.frames * numbers > chunk.bytes:
            return f"{chunk.file} cannot hold {chunk.frames} frames in {chunk.bytes} bytes"
    needed = manifest.frames * sum(sizes.values())
    if needed > LARGEST_FRAMES:
        return f"its frames take {needed / 2**30:.0f} GiB of memory, at most {LARGEST_FRAMES >> 30} are read"
    if len({design.number for design in manifest.designs}) < len(manifest.designs):
        return "it numbers two designs alike"
    for design in manifest.designs:
        if not 0 <= design.family < len(manifest.families):
            return f"design {design.number} is of family {design.family}, of {len(manifest.families)}"
        if not 0 <= design.scenario < len(manifest.scenarios):
            return f"design {design.number} is of scenario {design.scenario}, of {len(manifest.scenarios)}"
    return None
