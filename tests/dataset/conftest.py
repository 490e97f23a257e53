"""Small made-up frames of designs of a made-up system, and a dataset of them on disk."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from exosight.dataset.frames import Frames, concatenate
from exosight.dataset.manifest import new_manifest, write_manifest
from exosight.dataset.store import write_chunk
from exosight.system.camera import Camera
from exosight.system.design import Design
from exosight.system.schema import Channel, Schema, SensorSpec, ViewSpec

CAMERA = Camera(width=6, height=4)
SCHEMA = Schema(
    "bench",
    (Channel("push", "N", -1.0, 4.0), Channel("pull", "kPa", 0.0, 80.0)),
    (
        SensorSpec("P1", "contact force", "N", estimated=True),
        SensorSpec("P2", "contact force", "N", estimated=True),
        SensorSpec("P3", "contact force", "N", estimated=True),
        SensorSpec("F_net", "net force", "N", parts=("P1", "P2", "P3")),
        SensorSpec("knuckle", "joint angle", "rad"),
    ),
    (ViewSpec("side", CAMERA.width, CAMERA.height),),
)
FAMILIES = ("plain", "waved", "tapered", "rare", "odd")
SCENARIOS = ("length", "plain", "waved", "tapered", "rare", "odd")
DOFS = 25


def designs_of(per_scenario: int) -> tuple[Design, ...]:
    """So many of each scenario; of the first family there are those of two scenarios."""
    return tuple(
        Design(number, max(number // per_scenario - 1, 0), number // per_scenario, {"length": 0.08 + number})
        for number in range(per_scenario * len(SCENARIOS))
    )


DESIGNS = designs_of(2)[:11]


def made_up(designs: Sequence[Design], per_design: int = 3, seed: int = 0, schema: Schema = SCHEMA) -> Frames:
    """Frames with valid labels and random content, `per_design` of each design."""
    rng = np.random.default_rng(seed)
    count = len(designs) * per_design
    (low, high), view = schema.limits, schema.cameras[0]
    return Frames(
        schema=schema,
        images=rng.integers(0, 256, (count, view.height, view.width), dtype=np.uint8),
        sensors=rng.random((count, len(schema.sensors)), dtype=np.float32),
        commands=rng.uniform(0.9 * low, 0.9 * high, (count, len(low))).astype(np.float32),
        pose=rng.normal(size=(count, DOFS)),
        design=np.repeat(np.array([each.number for each in designs], np.int32), per_design),
        family=np.repeat(np.array([each.family for each in designs], np.int8), per_design),
        scenario=np.repeat(np.array([each.scenario for each in designs], np.int8), per_design),
        step=np.tile(np.arange(per_design, dtype=np.int32), len(designs)),
    )


def describe(chunks, **change):
    """A manifest of chunks made with `made_up`."""
    entries = {
        "config": {"young": 3e5},
        "seed": 0,
        "system": "bench",
        "schema": SCHEMA,
        "description": None,
        "camera": CAMERA,
        "dofs": DOFS,
        "families": FAMILIES,
        "scenarios": SCENARIOS,
        "designs": DESIGNS,
        "chunks": tuple(chunks),
        "dropped": {"crosses_itself": 2},
    }
    return new_manifest(**(entries | change))


@pytest.fixture
def parts() -> list[Frames]:
    """The frames of a first and a second chunk."""
    return [made_up(DESIGNS[:6], seed=1), made_up(DESIGNS[6:], seed=2)]


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
