"""Learning from several datasets: nothing that is kept for testing slips in with the others."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cards import made_up
from schemas import mixed_schema, published_schema

from exosight.app import pipeline
from exosight.app.data import Data, divided, load
from exosight.app.pipeline import Sources, fit, widened
from exosight.app.provenance import identity
from exosight.app.provenance import test_part as part_to_judge
from exosight.control.estimator import DEFAULT_MODEL, OnnxEstimator
from exosight.dataset import dataset_identity, make_split
from exosight.dataset.config import GenerateConfig
from exosight.errors import InputError
from exosight.exosuit.published import PublishedDesigns
from exosight.learning import TrainConfig
from exosight.system.camera import Camera
from exosight.system.design import Design

PUBLISHED = PublishedDesigns()
key = PUBLISHED.key


def drawn(seed: int) -> tuple[Design, ...]:
    return PUBLISHED.draw(1, seed)


@pytest.fixture
def first(data: Path) -> Data:
    return load(data)


def hash_of(data: Data) -> str:
    return dataset_identity(data.manifest)["sha256"]


def test_frames_of_judged_designs_are_left_out_whatever_their_numbers(
    first: Data, make_dataset: Callable[..., Path], tmp_path: Path
) -> None:
    # The same eleven shapes, numbered backwards, and eleven others.
    turned = tuple(replace(d, number=1000 - d.number) for d in drawn(0))
    again = load(make_dataset(tmp_path / "again", designs=turned, seed=1))
    fresh = load(make_dataset(tmp_path / "fresh", designs=drawn(5), seed=2))
    split = make_split(first.frames, "design", 0)
    frames, wider = widened(first, split, [again, fresh])

    assert np.array_equal(wider.validation, split.validation)
    assert np.array_equal(wider.test, split.test)
    assert np.array_equal(wider.train[: len(split.train)], split.train)
    by_number = {d.number: key(d) for d in first.manifest.designs}
    judged = {by_number[n] for n in first.frames.design[[*split.validation, *split.test]].tolist()}
    seen = {key(d): d.number for d in turned}
    added = frames.design[len(first.frames) :]
    assert not {seen[each] for each in judged} & set(added.tolist())
    learned = {by_number[n] for n in first.frames.design[split.train].tolist()}
    assert {seen[each] for each in learned} <= set(added.tolist())
    assert len(wider.train) == len(split.train) + len(added)
    # Images and labels stay together.
    last = len(frames) - 1
    place = np.flatnonzero(np.all(fresh.frames.images == frames.images[last], axis=(1, 2)))
    assert np.array_equal(fresh.frames.labels[place[0]], frames.labels[last])


@pytest.mark.parametrize("family", ["linear", "sine", "legendre"])
def test_a_held_out_family_is_left_out_of_all_datasets(
    first: Data, make_dataset: Callable[..., Path], tmp_path: Path, family: str
) -> None:
    """Also exosuits of the family that the first dataset does not have: the kind is to be unseen."""
    other = load(make_dataset(tmp_path / "other", designs=drawn(5), seed=2))
    split = divided(first, "family", 0, family)
    frames, wider = widened(first, split, [other])
    number = PUBLISHED.families.index(family)
    assert (other.frames.family == number).any()
    assert not (frames.family[wider.train] == number).any()
    added = frames.design[len(first.frames) :]
    judged = {d.number: key(d) for d in first.manifest.designs}
    kept = {judged[n] for n in first.frames.design[split.validation].tolist()}
    others = {d.number for d in other.manifest.designs if d.family != number and key(d) not in kept}
    assert set(added.tolist()) == others


def test_a_held_out_camera_is_left_out_of_all_datasets(
    make_dataset: Callable[..., Path], tmp_path: Path
) -> None:
    """Of another dataset, frames below the smallest value that is held out are learned from, none above."""
    roll = "appearance.roll"
    first = load(make_dataset(tmp_path / "first", varies=(roll,)))
    other = load(make_dataset(tmp_path / "other", designs=drawn(5), seed=2, varies=(roll,)))
    split = divided(first, "variation", 0, roll)
    frames, wider = widened(first, split, [other])
    assert np.array_equal(wider.test, np.flatnonzero(first.variation[roll] >= split.edge))
    own = {key(d) for d in first.manifest.designs}
    new = [d.number for d in other.manifest.designs if key(d) not in own]
    below = np.isin(other.frames.design, new) & (other.variation[roll] < split.edge)
    assert 0 < below.sum() < np.isin(other.frames.design, new).sum()
    added = wider.train[len(split.train) :]
    assert np.array_equal(frames.labels[added], other.frames.labels[below])

    still = load(make_dataset(tmp_path / "still", designs=drawn(5), seed=2))
    with pytest.raises(InputError, match=r"datasets in which appearance\.roll varies, got one"):
        widened(first, split, [still])


def test_one_dataset_is_taken_as_it_is(first: Data) -> None:
    split = make_split(first.frames, "design", 0)
    frames, wider = widened(first, split, [])
    assert frames is first.frames
    assert np.array_equal(wider.train, split.train)


def test_another_camera_is_refused(first: Data, make_dataset: Callable[..., Path], tmp_path: Path) -> None:
    other = load(make_dataset(tmp_path / "other", camera=Camera(width=32, height=32)))
    with pytest.raises(InputError, match="expected datasets of one camera, got several"):
        widened(first, make_split(first.frames, "design", 0), [other])


def test_the_network_remembers_all_its_datasets(
    first: Data, make_dataset: Callable[..., Path], tmp_path: Path
) -> None:
    """Also those of the network that it goes on from, and of the one before that."""
    split = make_split(first.frames, "design", 0)
    second, third = (
        load(make_dataset(tmp_path / str(seed), designs=drawn(seed), seed=seed)) for seed in (2, 3)
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


def test_shipped_network_is_judged_on_the_designs_that_it_has_not_learned_from(first: Data) -> None:
    """That of `exosight generate --per-scenario 125`: its own split by design, whatever frames are kept."""
    card = OnnxEstimator.load(DEFAULT_MODEL).card
    designs = PUBLISHED.draw(125, seed=0)
    frames = replace(
        first.frames,
        schema=PUBLISHED.schema,
        **{
            name: np.resize(
                getattr(first.frames, name), (len(designs), *getattr(first.frames, name).shape[1:])
            )
            for name in ("images", "sensors", "commands", "pose", "family", "step")
        },
        design=np.array([d.number for d in designs], np.int32),
        scenario=np.array([d.scenario for d in designs], np.int8),
    )
    made = Data(replace(first.manifest, schema=PUBLISHED.schema, designs=designs), frames)
    index, words = part_to_judge(card, made)
    assert words == "test part by design"
    assert np.array_equal(index, make_split(frames, "design", 0).test)
    assert len(index) == 275
    other = Data(replace(made.manifest, seed=9), frames)
    assert part_to_judge(card, other)[1] == "all frames of another dataset"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"schema": mixed_schema(32, 32)}, "expected the sensors zone_0, .*, got C1, C2"),
        ({"schema": published_schema(32, 36)}, "camera camera: expected width 36, got 32"),
        (
            {"schema": published_schema(32, 32, "depth")},
            "camera camera: expected visibility depth, got stacked",
        ),
    ],
)
def test_a_network_of_another_system_is_refused(first: Data, changes: dict, said: str) -> None:
    with pytest.raises(InputError, match=f"the dataset is of another system than the network: {said}"):
        part_to_judge(made_up(32, 32, **changes), first)


def test_channels_count_where_they_are_inputs(first: Data) -> None:
    faster = replace(published_schema(32, 32).channels[0], high=7.0)
    schema = replace(published_schema(32, 32), channels=(faster,))
    made_up(32, 32, schema=schema).check_fits(first.frames.schema, "dataset")
    with pytest.raises(InputError, match="channel u: expected high 7, got 6"):
        made_up(32, 32, schema=schema, actuation=True).check_fits(first.frames.schema, "dataset")


def test_every_epoch_may_bring_designs_never_seen(
    first: Data, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The stream is asked for frames of the dataset's kind, without its designs, from the epoch on."""
    asked: dict[str, object] = {}

    @contextmanager
    def stream(config: GenerateConfig, per_scenario: int, **options: object) -> Iterator:
        asked.update(options, config=config, per_scenario=per_scenario)
        yield iter([first.frames] * 2)

    monkeypatch.setattr(pipeline, "stream", stream)
    config, split = TrainConfig(epochs=2, batch=8, threads=1), make_split(first.frames, "design", 0)
    fit(first, split, config, tmp_path / "run", sources=Sources(online_designs=3), resume=False)
    assert asked == {
        "config": GenerateConfig(),
        "per_scenario": 3,
        "description": None,
        "exclude": first.manifest.designs,
        "start": 0,
    }
    assert (tmp_path / "run" / "model.onnx").exists()
    with pytest.raises(InputError, match="its online_designs is 3, asked for is 0"):
        fit(first, split, config, tmp_path / "run", resume=True)
