"""Learning from several datasets: nothing that is kept for judging slips in with the others."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cards import made_up
from pydantic import TypeAdapter

from exosight.app import pipeline
from exosight.app.pipeline import Data, divided, fit, identity, load, widened
from exosight.control.estimator import DEFAULT_MODEL, OnnxEstimator
from exosight.dataset import dataset_identity, make_split, new_manifest
from exosight.dataset.config import GenerateConfig
from exosight.dataset.manifest import ChunkEntry, sampled_shapes
from exosight.errors import InputError
from exosight.exosuit.assembly import MAX_FORCE
from exosight.exosuit.scenarios import SampledShape, geometry, sample_shapes
from exosight.exosuit.shapes import FAMILIES
from exosight.learning import TrainConfig
from exosight.system.camera import Camera


@pytest.fixture
def first(data: Path) -> Data:
    return load(data)


def hash_of(data: Data) -> str:
    return dataset_identity(data.manifest)["sha256"]


def test_frames_of_judged_shapes_are_left_out_whatever_their_numbers(
    first: Data, make_dataset: Callable[..., Path], tmp_path: Path
) -> None:
    # The same eleven shapes, numbered backwards, and eleven others.
    shapes = sample_shapes(1, seed=0)
    turned = [replace(s, shape_id=1000 - s.shape_id) for s in shapes]
    again = load(make_dataset(tmp_path / "again", shapes=turned, seed=1))
    fresh = load(make_dataset(tmp_path / "fresh", shapes=sample_shapes(1, seed=5), seed=2))
    split = make_split(first.frames, "shape", 0)
    frames, wider = widened(first, split, [again, fresh])

    assert np.array_equal(wider.validation, split.validation)
    assert np.array_equal(wider.test, split.test)
    assert np.array_equal(wider.train[: len(split.train)], split.train)
    by_number = {s.shape_id: geometry(s.shape) for s in sampled_shapes(first.manifest)}
    judged = {by_number[n] for n in first.frames.shape_id[[*split.validation, *split.test]].tolist()}
    seen = {geometry(s.shape): s.shape_id for s in turned}
    added = frames.shape_id[len(first.frames) :]
    assert not {seen[shape] for shape in judged} & set(added.tolist())
    learned = {by_number[n] for n in first.frames.shape_id[split.train].tolist()}
    assert {seen[shape] for shape in learned} <= set(added.tolist())
    assert len(wider.train) == len(split.train) + len(added)
    # Images and labels stay together.
    last = len(frames) - 1
    place = np.flatnonzero(np.all(fresh.frames.images == frames.images[last], axis=(1, 2)))
    assert np.array_equal(fresh.frames.forces[place[0]], frames.forces[last])


@pytest.mark.parametrize("family", ["linear", "sine", "legendre"])
def test_a_held_out_family_is_left_out_of_all_datasets(
    first: Data, make_dataset: Callable[..., Path], tmp_path: Path, family: str
) -> None:
    """Also exosuits of the family that the first dataset does not have: the kind is to be unseen."""
    other = load(make_dataset(tmp_path / "other", shapes=sample_shapes(1, seed=5), seed=2))
    split = make_split(first.frames, "family", 0, family)
    frames, wider = widened(first, split, [other])
    number = list(FAMILIES).index(family)
    assert (other.frames.family == number).any()
    assert not (frames.family[wider.train] == number).any()
    added = frames.shape_id[len(first.frames) :]
    others = [s for s in sampled_shapes(other.manifest) if s.shape.surface.family != family]
    judged = {s.shape_id: geometry(s.shape) for s in sampled_shapes(first.manifest)}
    kept = {judged[n] for n in first.frames.shape_id[split.validation].tolist()}
    assert set(added.tolist()) == {s.shape_id for s in others if geometry(s.shape) not in kept}


def test_a_held_out_camera_is_left_out_of_all_datasets(
    make_dataset: Callable[..., Path], tmp_path: Path
) -> None:
    """Of another dataset, frames below the smallest value that is held out are learned from, none above."""
    roll = "appearance.roll"
    first = load(make_dataset(tmp_path / "first", varies=(roll,)))
    other = load(make_dataset(tmp_path / "other", shapes=sample_shapes(1, seed=5), seed=2, varies=(roll,)))
    split = divided(first, "variation", 0, roll)
    frames, wider = widened(first, split, [other])
    assert np.array_equal(wider.test, np.flatnonzero(first.variation[roll] >= split.edge))
    known = {s.shape_id: geometry(s.shape) for s in sampled_shapes(other.manifest)}
    own = {geometry(s.shape) for s in sampled_shapes(first.manifest)}
    new = [n for n, shape in known.items() if shape not in own]
    below = np.isin(other.frames.shape_id, new) & (other.variation[roll] < split.edge)
    assert 0 < below.sum() < np.isin(other.frames.shape_id, new).sum()
    added = wider.train[len(split.train) :]
    assert np.array_equal(frames.forces[added], other.frames.forces[below])

    still = load(make_dataset(tmp_path / "still", shapes=sample_shapes(1, seed=5), seed=2))
    with pytest.raises(InputError, match=r"datasets in which appearance\.roll varies, got one"):
        widened(first, split, [still])


def test_one_dataset_is_taken_as_it_is(first: Data) -> None:
    split = make_split(first.frames, "shape", 0)
    frames, wider = widened(first, split, [])
    assert frames is first.frames
    assert np.array_equal(wider.train, split.train)


def test_another_camera_is_refused(first: Data, make_dataset: Callable[..., Path], tmp_path: Path) -> None:
    other = load(make_dataset(tmp_path / "other", camera=Camera(width=32, height=32)))
    with pytest.raises(InputError, match="expected datasets of one camera and plant"):
        widened(first, make_split(first.frames, "shape", 0), [other])


def test_the_network_remembers_all_its_datasets(
    first: Data, make_dataset: Callable[..., Path], tmp_path: Path
) -> None:
    """Also those of the network that it goes on from, and of the one before that."""
    split = make_split(first.frames, "shape", 0)
    second, third = (
        load(make_dataset(tmp_path / str(seed), shapes=sample_shapes(1, seed=seed), seed=seed))
        for seed in (2, 3)
    )
    alone, both = identity(first, split), identity(first, split, [second.manifest])
    assert (alone["extra_data"], alone["extra_data_seeds"]) == ("", "")
    assert (both["extra_data"], both["extra_data_seeds"]) == (identity(second, split)["sha256"], "2")
    further = identity(third, split, start=made_up(32, 32, data=both))
    assert further["extra_data"] == f"{hash_of(first)}, {hash_of(second)}"
    assert further["extra_data_seeds"] == "0, 2"
    again = identity(first, split, start=made_up(32, 32, data=further))
    assert again["extra_data"] == f"{hash_of(third)}, {hash_of(second)}"
    assert again["extra_data_seeds"] == "3, 2"


def test_shipped_network_knows_its_dataset_wherever_it_is_made() -> None:
    """That of `exosight generate --per-scenario 125`, of which 51,604 frames are kept."""
    config = GenerateConfig(per_scenario=125)
    chunk = ChunkEntry("chunk_0000.h5", "0" * 64, bytes=1, frames=51_604, shape_ids=(0,))
    made = new_manifest(
        config=TypeAdapter(GenerateConfig).dump_python(config, mode="json"),
        seed=config.seed,
        camera=config.camera,
        load_limit=MAX_FORCE,
        dofs=25,
        shapes=sample_shapes(config.per_scenario, config.seed),
        chunks=[chunk],
        dropped={"not_converged": 0, "crosses_itself": 16_045, "tip_below_finger": 1_101},
    )
    assert OnnxEstimator.load(DEFAULT_MODEL).card.data["sha256"] == dataset_identity(made)["sha256"]


def test_every_epoch_may_bring_exosuits_never_seen(
    first: Data, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The stream is asked for frames of the dataset's kind, without its shapes, from the epoch on."""
    asked: dict[str, object] = {}

    @contextmanager
    def stream(config: GenerateConfig, *, exclude: Iterable[SampledShape], start: int) -> Iterator:
        asked.update(config=config, exclude=[s.shape for s in exclude], start=start)
        yield iter([first.frames] * 2)

    monkeypatch.setattr(pipeline, "stream", stream)
    config = TrainConfig(epochs=2, batch=8, threads=1)
    fit(first, make_split(first.frames, "shape", 0), config, tmp_path / "run", online_shapes=3, resume=False)
    manifest = first.manifest
    known = TypeAdapter(GenerateConfig).validate_python(manifest.config)
    assert asked["config"] == replace(known, per_scenario=3)
    assert asked["exclude"] == [s.shape for s in sampled_shapes(manifest)]
    assert asked["start"] == 0
    assert (tmp_path / "run" / "model.onnx").exists()
    with pytest.raises(InputError, match="its online_shapes is 3, asked for is 0"):
        fit(first, make_split(first.frames, "shape", 0), config, tmp_path / "run", resume=True)
