"""Small made-up frames of sampled shapes, and a dataset of them on disk."""

import json
from pathlib import Path

import numpy as np
import pytest

from exosight.dataset.frames import Frames, concatenate
from exosight.dataset.manifest import new_manifest, write_manifest
from exosight.dataset.store import write_chunk
from exosight.exosuit.scenarios import SampledShape, sample_shapes
from exosight.exosuit.shapes import FAMILIES
from exosight.system.camera import Camera

CAMERA = Camera(width=6, height=4)
SHAPES = sample_shapes(1, seed=0)


def made_up(shapes: list[SampledShape], per_shape: int = 3, seed: int = 0) -> Frames:
    """Frames with valid labels and random content, `per_shape` of each shape."""
    rng = np.random.default_rng(seed)
    count = len(shapes) * per_shape
    numbers = np.repeat([shape.shape_id for shape in shapes], per_shape)
    families = [list(FAMILIES).index(shape.shape.surface.family) for shape in shapes]
    return Frames(
        images=rng.integers(0, 256, (count, CAMERA.height, CAMERA.width), dtype=np.uint8),
        forces=rng.random((count, 7), dtype=np.float32),
        u=4 * rng.random(count, dtype=np.float32),
        pose=rng.normal(size=(count, 25)),
        shape_id=numbers.astype(np.int32),
        family=np.repeat(families, per_shape).astype(np.int8),
        scenario=np.repeat([shape.scenario for shape in shapes], per_shape).astype(np.int8),
        loading=rng.choice(np.array([-1, 1], np.int8), count),
    )


def describe(chunks, **change):
    """A manifest of chunks made with `made_up`."""
    entries = {
        "config": {"young": 3e5},
        "seed": 0,
        "camera": CAMERA,
        "load_limit": 4.0,
        "dofs": 25,
        "shapes": SHAPES,
        "chunks": chunks,
        "dropped": {"tip below fingertip": 2},
    }
    return new_manifest(**(entries | change))


@pytest.fixture
def parts() -> list[Frames]:
    """The frames of a first and a second chunk."""
    return [made_up(SHAPES[:6], seed=1), made_up(SHAPES[6:], seed=2)]


@pytest.fixture
def frames(parts: list[Frames]) -> Frames:
    return concatenate(parts)


@pytest.fixture
def dataset(tmp_path: Path, parts: list[Frames]) -> Path:
    """A complete dataset of two chunks."""
    folder = tmp_path / "dataset"
    folder.mkdir()
    write_manifest(folder, describe([write_chunk(folder, i, part) for i, part in enumerate(parts)]))
    return folder


@pytest.fixture
def edit_manifest(dataset: Path):
    """Change the manifest on disk: edit_manifest(lambda values: …) works on its JSON."""

    def edit(change) -> None:
        path = dataset / "manifest.json"
        values = json.loads(path.read_text())
        change(values)
        path.write_text(json.dumps(values))

    return edit
