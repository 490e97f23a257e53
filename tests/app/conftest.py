"""The command line called in-process; a made-up dataset and a network trained on it for an epoch."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from exosight.app.main import main
from exosight.dataset import Frames, new_manifest, write_chunk, write_manifest
from exosight.exosuit.scenarios import SampledShape, sample_shapes
from exosight.exosuit.shapes import FAMILIES
from exosight.system.camera import Camera

CAMERA = Camera(metres_per_pixel=0.0044, width=32, height=32)
PER_SHAPE = 4


def write_dataset(
    folder: Path,
    camera: Camera = CAMERA,
    shapes: list[SampledShape] | None = None,
    seed: int = 0,
    varies: tuple[str, ...] = (),
) -> Path:
    """Frames with valid labels and random content, of one shape a scenario if not told otherwise.

    varies  names of what varies from frame to frame, evenly within 0…1
    """
    shapes = sample_shapes(1, seed=0) if shapes is None else shapes
    rng = np.random.default_rng(seed)
    count = len(shapes) * PER_SHAPE
    families = [list(FAMILIES).index(shape.shape.surface.family) for shape in shapes]
    frames = Frames(
        images=rng.integers(0, 256, (count, camera.height, camera.width), dtype=np.uint8),
        forces=rng.random((count, 7), dtype=np.float32),
        u=4 * rng.random(count, dtype=np.float32),
        pose=rng.normal(size=(count, 25)),
        shape_id=np.repeat([shape.shape_id for shape in shapes], PER_SHAPE).astype(np.int32),
        family=np.repeat(families, PER_SHAPE).astype(np.int8),
        scenario=np.repeat([shape.scenario for shape in shapes], PER_SHAPE).astype(np.int8),
        loading=np.ones(count, dtype=np.int8),
    )
    folder.mkdir()
    manifest = new_manifest(
        config={},
        seed=seed,
        camera=camera,
        load_limit=4.0,
        dofs=25,
        shapes=shapes,
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
