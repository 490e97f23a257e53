"""Recordings and datasets: HDF5 files with other arrays, links, texts and bytes, and manifests to match."""

import hashlib
import json
import os
import random
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
from schemas import published_schema
from toy import controller

from benchmarks.fuzz import some_bytes, some_values
from exosight.control import Guarded, Scheduled, State
from exosight.control.estimator import Reading
from exosight.control.guard import Measurement
from exosight.control.realtime import Step
from exosight.control.recording import Recorder, read_recording
from exosight.control.replay import replay
from exosight.dataset.frames import Frames
from exosight.dataset.manifest import MANIFEST, new_manifest, write_manifest
from exosight.dataset.store import read_frames, read_variation, write_chunk
from exosight.system.camera import Camera
from exosight.system.design import Design

SHAPE = (4, 6)
POOL = 300
"""Files with other arrays, links and texts that are made once; their bytes are changed each time."""

_NUMBERS = (np.nan, np.inf, -np.inf, -1, 0, 1, 4, 127, 1e9, 1e300, 5e-324)


class Recording:
    """Recordings: read, and replayed if they are accepted."""

    def __init__(self, folder: Path) -> None:
        os.mkfifo(folder / "pipe")
        self._path = folder / "mutation.h5"
        recorder = Recorder(self._path, SHAPE, Guarded(Scheduled(controller())), Path(__file__))
        draw = np.random.default_rng(0)
        for i in range(25):
            image = draw.integers(0, 256, SHAPE, np.uint8)
            measurement = Measurement(image if i % 7 else None, _read(image[None]), 0.05)
            recorder.append(Step(i / 10, 0.2, measurement, None, 0.1 * i, State.NORMAL, "", np.zeros(4), 0.0))
        recorder.close()
        self._pool = _pool(self._path.read_bytes(), folder)

    def __call__(self, draw: random.Random) -> None:
        """One recording."""
        content = draw.choice(self._pool)
        self._path.write_bytes(content if draw.random() < 0.05 else some_bytes(content, draw))
        replay(read_recording(self._path), _read)


class Dataset:
    """Datasets of one chunk, whose manifest vouches for what the chunk has become."""

    def __init__(self, folder: Path) -> None:
        os.mkfifo(folder / "pipe")
        self._folder = folder / "dataset"
        self._folder.mkdir()
        schema = published_schema()
        view, draw = schema.cameras[0], np.random.default_rng(0)
        count, dofs = 6, 5
        low, high = schema.limits
        frames = Frames(
            schema,
            images=draw.integers(0, 2, (count, view.height, view.width), np.uint8),
            sensors=draw.random((count, len(schema.sensors)), np.float32),
            commands=np.tile((low + high) / 2, (count, 1)).astype(np.float32),
            pose=draw.normal(size=(count, dofs)),
            design=np.repeat(np.arange(2, dtype=np.int32), 3),
            family=np.zeros(count, np.int8),
            scenario=np.zeros(count, np.int8),
            step=np.tile(np.arange(3, dtype=np.int32), 2),
        )
        entry = write_chunk(self._folder, 0, frames, {"plant.young": np.linspace(1.0, 2.0, count)})
        manifest = new_manifest(
            config={"young": 3e5},
            seed=0,
            system=schema.system,
            schema=schema,
            description=None,
            camera=Camera(width=view.width, height=view.height),
            dofs=dofs,
            families=("plain",),
            scenarios=("length",),
            designs=tuple(Design(number, 0, 0, {"length": 0.08}) for number in range(2)),
            chunks=(entry,),
            dropped={},
        )
        write_manifest(self._folder, manifest)
        self._chunk, self._manifest = self._folder / entry.file, self._folder / MANIFEST
        self._content, self._text = self._chunk.read_bytes(), self._manifest.read_text()
        self._pool = _pool(self._content, folder)

    def __call__(self, draw: random.Random) -> None:
        """One dataset."""
        content, values = self._content, json.loads(self._text)
        if draw.random() < 0.6:
            content = draw.choice(self._pool)
            content = content if draw.random() < 0.1 else some_bytes(content, draw)
        if draw.random() < 0.95:
            sealed = {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
            values["chunks"][0].update(sealed)
        if draw.random() < 0.5:
            some_values(values, draw)
        text = json.dumps(values).encode()
        self._chunk.write_bytes(content)
        self._manifest.write_bytes(some_bytes(text, draw) if draw.random() < 0.1 else text)
        read_frames(self._folder)
        read_variation(self._folder)


def _read(images: np.ndarray) -> Reading:
    """A made-up network of seven outputs."""
    forces = np.full((1, 7), images[0, 0, 0] / 500, np.float32)
    return Reading(forces, forces - 0.001, forces + 0.001, forces, np.array([0.1], np.float32))


def _pool(content: bytes, folder: Path) -> list[bytes]:
    """The file itself, and others in which one to three members or texts are something else."""
    found = [content]
    for number in range(POOL):
        draw = random.Random(number)
        (path := folder / "pool.h5").write_bytes(content)
        with h5py.File(path, "a") as file:
            for _ in range(draw.choice((1, 1, 2, 3))):
                change = draw.choice((_value, _value, _value, _array, _array, _link, _text, _shape))
                with suppress(
                    ArithmeticError, LookupError, OSError, ValueError, TypeError
                ):  # what HDF5 cannot write
                    change(file, folder, draw)
        found.append(path.read_bytes())
        path.unlink()
    return found


def _member(file: h5py.File, draw: random.Random, kind: type = h5py.Dataset) -> str:
    names: list[str] = []

    def note(name: str, each: object) -> None:
        if isinstance(each, kind) and not getattr(each, "is_virtual", False):
            names.append(name)

    file.visititems(note)
    return draw.choice(names)


def _value(file: h5py.File, folder: Path, draw: random.Random) -> None:
    """Another number in an array."""
    data = file[_member(file, draw)]
    if data.dtype.kind in "fiub" and data.size and not data.is_virtual and not data.external:
        value = draw.choice(_NUMBERS)
        place = tuple(draw.randrange(side) for side in data.shape)
        with np.errstate(all="ignore"):
            data[place] = value if data.dtype.kind == "f" or (np.isfinite(value) and abs(value) < 128) else 1


def _array(file: h5py.File, folder: Path, draw: random.Random) -> None:
    """Something else in the place of an array."""
    name = _member(file, draw)
    shape = file[name].shape
    del file[name]
    far: Callable[..., object] = file.create_dataset
    match draw.randrange(8):
        case 0:
            file.create_group(name)
        case 1:
            file[name] = draw.choice((1.0, b"text", "\x1b[31m", [b"a"] * 3))
        case 2:
            far(name, (10**9,), "f8")
        case 3:
            far(name, (10**6, *shape[1:]), "f8", chunks=True, compression=1)
        case 4:
            far(name, shape or (3,), draw.choice(("f4", "f8", "u1", "i4", "S9", h5py.string_dtype())))
        case 5:
            far(name, (20,), "f8", external=[(str(folder / "pipe"), 0, 160)])
        case 6:
            layout = h5py.VirtualLayout((20,), "f8", maxshape=(None,))
            source = h5py.VirtualSource(str(folder / "pipe"), "x", (20,), maxshape=(None,))
            layout[: h5py.h5s.UNLIMITED] = source[: h5py.h5s.UNLIMITED]
            file.create_virtual_dataset(name, layout)
        case _:
            far(
                name,
                (20, *shape[1:]),
                "u1",
                chunks=(10**8, *shape[1:]),
                maxshape=(None, *shape[1:]),
                shuffle=True,
            )


def _link(file: h5py.File, folder: Path, draw: random.Random) -> None:
    """A link in the place of a member."""
    name, other = _member(file, draw, draw.choice((h5py.Dataset, h5py.Group))), _member(file, draw)
    kept = file[other]
    del file[name]
    file[name] = draw.choice(
        (
            h5py.ExternalLink(str(folder / "pipe"), "/x"),
            h5py.SoftLink("/elsewhere"),
            h5py.SoftLink(f"/{name}"),
            kept,
            file,
        )
    )


def _text(file: h5py.File, folder: Path, draw: random.Random) -> None:
    """Another attribute."""
    if not file.attrs:
        return
    name = draw.choice(sorted(file.attrs))
    old = file.attrs[name]
    new: object = draw.choice(("", "\x1b]0;x\x07", "x" * 9000, "[" * 9000, np.zeros(3), 3, b"\xff\xfe"))
    if isinstance(old, str) and old.startswith("{") and draw.random() < 0.8:
        new = json.dumps(some_values(json.loads(old), draw))[:60_000]
    file.attrs[name] = new


def _shape(file: h5py.File, folder: Path, draw: random.Random) -> None:
    """Another length of an array that may grow."""
    data = file[_member(file, draw)]
    if data.maxshape and data.maxshape[0] is None and data.chunks:
        data.resize(draw.choice((0, 1, len(data) + 1, 10**6, 10**9)), axis=0)
