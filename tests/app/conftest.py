"""The command line called in-process; a made-up dataset and a network trained on it for an epoch."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from exosight.app.main import main
from exosight.dataset import Frames, new_manifest, write_chunk, write_manifest
from exosight.exosuit.published import PublishedDesigns
from exosight.system.camera import Camera
from exosight.system.design import Design

CAMERA = Camera(metres_per_pixel=0.0044, width=32, height=32)
PER_DESIGN = 4


def designs_of(seed: int) -> tuple[Design, ...]:
    """One design a scenario of the published system."""
    return PublishedDesigns().draw(1, seed)


def write_dataset(
    folder: Path,
    camera: Camera = CAMERA,
    designs: tuple[Design, ...] | None = None,
    seed: int = 0,
    varies: tuple[str, ...] = (),
) -> Path:
    """Frames with valid labels and random content, of one design a scenario if not told otherwise.

    varies  names of what varies from frame to frame, evenly within 0…1
    """
    designs = designs_of(0) if designs is None else designs
    published = PublishedDesigns(camera=camera)
    schema = published.schema
    rng = np.random.default_rng(seed)
    count = len(designs) * PER_DESIGN
    sensors = rng.random((count, len(schema.sensors)), dtype=np.float32)
    sensors[:, schema.index("F_net")] = sensors[:, schema.output_indices()].sum(axis=1)
    frames = Frames(
        schema=schema,
        images=rng.integers(0, 256, (count, camera.height, camera.width), dtype=np.uint8),
        sensors=sensors,
        commands=4 * rng.random((count, 1), dtype=np.float32),
        pose=rng.normal(size=(count, 25)),
        design=np.repeat([design.number for design in designs], PER_DESIGN).astype(np.int32),
        family=np.repeat([design.family for design in designs], PER_DESIGN).astype(np.int8),
        scenario=np.repeat([design.scenario for design in designs], PER_DESIGN).astype(np.int8),
        step=np.tile(np.arange(PER_DESIGN), len(designs)).astype(np.int32),
    )
    folder.mkdir()
    manifest = new_manifest(
        config={},
        seed=seed,
        system=schema.system,
        schema=schema,
        description=None,
        camera=camera,
        dofs=25,
        families=published.families,
        scenarios=published.scenarios,
        designs=designs,
        chunks=[write_chunk(folder, 0, frames, {name: rng.random(count) for name in varies})],
        dropped={},
    )
    write_manifest(folder, manifest)
    return folder


@pytest.fixture(scope="session")
def make_dataset() -> Callable[..., Path]:
    return write_dataset


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of 44 frames of 32×32 pixels; tests that change it work on a copy."""
    return write_dataset(tmp_path_factory.mktemp("made_up") / "data")


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory, data: Path) -> Path:
    """A network trained on it for one epoch."""
    folder = tmp_path_factory.mktemp("runs") / "light"
    main(["train", "--data", str(data), "--out", str(folder), "--epochs", "1", "--threads", "1"])
    return folder


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Call the command line with words that it has to refuse; returns its one sentence."""

    def call(*words: object) -> str:
        capsys.readouterr()
        with pytest.raises(SystemExit) as end:
            main([str(word) for word in words])
        shown = capsys.readouterr()
        assert end.value.code == 2, shown.err
        assert shown.out == ""
        assert shown.err.count("\n") == 1, shown.err
        assert shown.err.startswith("exosight: ")
        return shown.err.removeprefix("exosight: ").rstrip("\n")

    return call
