"""The manifest of a dataset: what is in the folder, how it was made, and the checksum of every chunk.

It is written last, so a folder with a manifest is a complete dataset.
"""

import hashlib
import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field, JsonValue, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from exosight import __version__
from exosight.dataset.frames import QUANTITIES
from exosight.errors import DataError, InputError
from exosight.exosuit.scenarios import SCENARIOS, SampledShape, sampled_from_dict, sampled_to_dict
from exosight.exosuit.shapes import FAMILIES
from exosight.files import write_new_file
from exosight.system.camera import Camera

FORMAT = 1
"""Version of the layout on disk; a reader takes this one and older."""
JOB = "job.json"
MANIFEST = "manifest.json"
LARGEST_MANIFEST = 64 * 2**20  # [bytes]; 1375 shapes take 0.4 MiB
LARGEST_FRAMES = 64 * 2**30  # [bytes] all images and poses in memory; the published dataset takes 1.1 GiB

Count = Annotated[int, Field(ge=0, le=100_000_000)]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
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
    shape_ids: tuple[Count, ...]
    """Shapes whose frames are in the file."""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Manifest:
    """What a dataset holds and how it was made; `new_manifest` fills in what follows from the package."""

    format: int
    """Version of the layout on disk."""
    exosight_version: str
    """Version of the package that wrote it."""
    seed: Annotated[int, Field(ge=0)]
    """Seed of everything random in it."""
    config: dict[str, JsonValue]
    """The configuration that makes it again."""
    camera: Camera
    """Camera of every image."""
    load_limit: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    """Largest magnitude of the actuation [N]."""
    dofs: Annotated[int, Field(ge=1, le=10_000)]
    """Generalised coordinates of a pose."""
    families: tuple[str, ...]
    """Names that the frames' `family` counts, from 0."""
    scenarios: tuple[str, ...]
    """Names that the frames' `scenario` counts, from 0."""
    quantities: dict[str, dict[str, str]]
    """Type, unit and meaning of every array."""
    shapes: tuple[dict[str, JsonValue], ...]
    """Every exosuit shape asked for, as `sampled_to_dict` writes it."""
    chunks: tuple[ChunkEntry, ...]
    """The files with the frames."""
    dropped: dict[str, Count]
    """Frames left out, by cause."""

    @property
    def frames(self) -> int:
        """Frames in all chunks."""
        return sum(chunk.frames for chunk in self.chunks)


_ADAPTER = TypeAdapter(Manifest)


def new_manifest(
    *,
    config: dict[str, Any],
    seed: int,
    camera: Camera,
    load_limit: float,
    dofs: int,
    shapes: list[SampledShape],
    chunks: list[ChunkEntry],
    dropped: dict[str, int],
) -> Manifest:
    """The manifest of frames that this version of the package has made.

    Raises InputError naming the first entry that does not fit.
    """
    quantities = {
        name: {"type": np.dtype(quantity.dtype).name, "unit": quantity.unit, "meaning": quantity.meaning}
        for name, quantity in QUANTITIES.items()
    }
    try:
        return Manifest(
            format=FORMAT,
            exosight_version=__version__,
            seed=seed,
            config=json.loads(json.dumps(config, allow_nan=False)),  # tuples become lists, as on disk
            camera=camera,
            load_limit=load_limit,
            dofs=dofs,
            families=tuple(FAMILIES),
            scenarios=tuple(scenario.name for scenario in SCENARIOS),
            quantities=quantities,
            shapes=tuple(sampled_to_dict(shape) for shape in shapes),
            chunks=tuple(sorted(chunks, key=lambda chunk: chunk.file)),
            dropped=dropped,
        )
    except ValidationError as error:
        raise InputError(f"manifest: {_first(error)}") from error
    except (TypeError, ValueError) as error:
        raise InputError(f"manifest: config must hold JSON values ({error})") from error


def sampled_shapes(manifest: Manifest) -> list[SampledShape]:
    """The exosuit shapes of a dataset, in the order of the manifest."""
    return [sampled_from_dict(dict(shape)) for shape in manifest.shapes]


def dataset_identity(manifest: Manifest) -> dict[str, Any]:
    """What tells one dataset from another, as JSON values: what it was made from, and how many frames remain.

    Not the checksums of its files: those change with the processor and the libraries that made them.
    """
    camera = TypeAdapter(Camera).dump_python(manifest.camera, mode="json")
    made = {
        "seed": manifest.seed,
        "config": manifest.config,
        "camera": camera,
        "load_limit": manifest.load_limit,
        "shapes": manifest.shapes,
        "frames": manifest.frames,
        "dropped": manifest.dropped,
    }
    return {
        "format": manifest.format,
        "sha256": hashlib.sha256(json.dumps(made, sort_keys=True).encode()).hexdigest(),
        "seed": manifest.seed,
        "frames": manifest.frames,
        "shapes": len(manifest.shapes),
        "camera": camera,
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
    damaged, of a newer format or contradicts itself.
    """
    path = folder / MANIFEST
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder; expected a dataset")
    if not path.is_file():
        if (folder / JOB).exists() or any(folder.glob("chunk_*.h5")):
            raise DataError(
                f"{folder}: incomplete dataset, it has no {MANIFEST}; "
                "go on with it: exosight generate --resume with the same options"
            )
        raise DataError(f"{folder}: not a dataset, it has no {MANIFEST}")
    if path.stat().st_size > LARGEST_MANIFEST:
        raise DataError(f"{path}: {path.stat().st_size} bytes, more than any manifest needs")
    content = path.read_bytes()
    try:
        values = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path}: truncated or damaged, it is not JSON ({error})") from error
    found = values.get("format") if isinstance(values, dict) else None
    if not isinstance(found, int) or found < 1:
        raise DataError(f"{path}: not the manifest of a dataset, it has no format number")
    if found > FORMAT:
        raise DataError(
            f"{path}: format {found}, written by a newer exosight; this one reads up to {FORMAT}: update it"
        )
    try:
        manifest = _ADAPTER.validate_json(content, strict=True)
    except ValidationError as error:
        raise DataError(f"{path}: damaged manifest, {_first(error)}") from error
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
    if manifest.families != tuple(FAMILIES)[: len(manifest.families)]:
        return f"its families {manifest.families} are not those of this version"
    if manifest.scenarios != tuple(each.name for each in SCENARIOS)[: len(manifest.scenarios)]:
        return f"its scenarios {manifest.scenarios} are not those of this version"
    if not manifest.chunks:
        return "it lists no chunks"
    if len({chunk.file for chunk in manifest.chunks}) < len(manifest.chunks):
        return "it lists a chunk twice"
    needed = manifest.frames * (manifest.camera.height * manifest.camera.width + 8 * manifest.dofs)
    if needed > LARGEST_FRAMES:
        return f"its frames take {needed / 2**30:.0f} GiB of memory, at most {LARGEST_FRAMES >> 30} are read"
    try:
        numbers = [shape.shape_id for shape in sampled_shapes(manifest)]
    except InputError as error:
        return str(error)
    if len(set(numbers)) < len(numbers):
        return "it numbers two shapes alike"
    return None


def _first(error: ValidationError) -> str:
    fault = error.errors()[0]
    place = ".".join(str(step) for step in fault["loc"])
    return f"{place}: {fault['msg']}, got {str(fault['input'])[:60]!r}"
