"""A network of three forces and an angle of a system of two channels: trained, exported, judged, and read."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from schemas import mixed_schema

from exosight.app.data import Data, divided
from exosight.app.evaluation import evaluate, write_evaluation
from exosight.app.main import main
from exosight.app.pipeline import MODEL, fit
from exosight.control import OnnxEstimator
from exosight.dataset import Frames, new_manifest
from exosight.learning import TrainConfig
from exosight.system.camera import Camera
from exosight.system.design import Design

SCHEMA = mixed_schema(32, 32)
DESIGNS = tuple(Design(number, 0, 0, {"size": 0.5 + 0.05 * number}) for number in range(10))
STEPS = 24


@pytest.fixture(scope="module")
def data() -> Data:
    """A blob of which place, height and width are three of the sensors; one zone is never loaded."""
    rng = np.random.default_rng(0)
    count = STEPS * len(DESIGNS)
    y, x = np.mgrid[:32, :32] / 32
    a, b, size = rng.uniform([0.25, 0.25, 0.5], [0.75, 0.75, 1.5], (count, 3)).T[:, :, None, None]
    images = (255 * np.exp(-((x - a) ** 2 + (y - b) ** 2) / (0.02 * size))).astype(np.uint8)
    force, angle, other = a[:, 0, 0], b[:, 0, 0] - 0.5, np.maximum(0, size[:, 0, 0] - 1)
    readings = np.zeros((count, len(SCHEMA.sensors)), np.float32)
    readings[:, SCHEMA.output_indices()] = np.stack([force, angle, other, 0 * force], axis=1)
    readings[:, SCHEMA.index("grip")] = other
    readings[:, SCHEMA.index("wrist")] = -angle
    frames = Frames(
        schema=SCHEMA,
        images=images,
        sensors=readings,
        commands=np.column_stack([80 * force, 4 * other]).astype(np.float32),
        pose=np.zeros((count, 2)),
        design=np.repeat(np.arange(len(DESIGNS)), STEPS).astype(np.int32),
        family=np.zeros(count, np.int8),
        scenario=np.zeros(count, np.int8),
        step=np.tile(np.arange(STEPS), len(DESIGNS)).astype(np.int32),
    )
    manifest = new_manifest(
        config={}, seed=0, system=SCHEMA.system, schema=SCHEMA, description={},
        camera=Camera(width=32, height=32), dofs=2, families=("hand",), scenarios=("vary",),
        designs=DESIGNS, chunks=[], dropped={},
    )  # fmt: skip
    return Data(manifest, frames)


@pytest.fixture(scope="module")
def model(data: Data, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hand") / "run"
    config = TrainConfig(epochs=15, batch=16, threads=1, precision="float32", recipe="clean")
    fit(data, divided(data, "design", 0, None), config, folder, resume=False)
    return folder / MODEL


def test_it_learns_an_angle_of_both_signs_beside_forces(data: Data, model: Path) -> None:
    estimator = OnnxEstimator.load(model)
    assert estimator.card.schema == SCHEMA
    test = divided(data, "design", 0, None).test
    read, truth = estimator.read(data.frames.images[test]), data.frames.labels[test]
    # 135 steps bring the errors of what varies to a fifth of its spread or so; a constant has all of it.
    error = np.sqrt(np.mean((read.forces - truth) ** 2, axis=0))
    assert (error[:3] < 0.5 * truth.std(axis=0)[:3]).all()
    assert (read.forces[:, 1] < -0.05).any()
    assert (read.forces[:, [0, 2, 3]] >= 0).all()
    assert (read.low[:, 1] < 0).any()
    assert (read.contact[:, 1] == 0).all()


def test_it_is_judged_without_the_paper_and_under_its_own_names(
    data: Data, model: Path, tmp_path: Path
) -> None:
    estimator = OnnxEstimator.load(model)
    found = evaluate(estimator, data, seed=0)
    assert "test part by design" in found.frames
    rows = {table.name: table.records() for table in found.tables}
    assert [row["sensor"] for row in rows["sensors"]][:2] == ["zone_0 [N]", "knuckle_of_the_index [rad]"]
    assert list(found.baselines) == ["mean of training", "commands only"]
    assert not any("paper" in key for table in rows.values() for row in table for key in row)
    write_evaluation(found, {"model": "m", "data": "d", "seed": 0}, estimator, tmp_path)
    head = (tmp_path / "forces.csv").read_text().splitlines()[0]
    assert "knuckle_of_the_index true [rad]" in head
    assert "the paper" not in (tmp_path / "evaluation.html").read_text()


def test_estimates_name_sensors_and_units(
    data: Data, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = tmp_path / "pose.png"
    cv2.imwrite(str(place), data.frames.images[3])
    main(["estimate", str(place), "--model", str(model), "--json", "-"])
    (found,) = json.loads(capsys.readouterr().out)["estimates"]
    read = OnnxEstimator.load(model).read(data.frames.images[3:4])
    assert [row["sensor"] for row in found["sensors"]] == list(SCHEMA.outputs)
    assert found["sensors"][1].keys() == {"sensor", "value_rad", "low_rad", "high_rad"}
    assert found["sensors"][1]["value_rad"] == pytest.approx(float(read.forces[0, 1]), abs=1e-6)
    assert found["sensors"][2].keys() == {"sensor", "force_N", "low_N", "high_N", "contact_probability"}
    assert found["grip_N"] == pytest.approx(float(read.forces[0, 2:].sum()), abs=1e-5)
    main(["estimate", str(place), "--model", str(model)])
    assert "knuckle_of_the_index [rad]" in capsys.readouterr().out
