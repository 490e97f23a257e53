"""The manifest: complete and exact, or refused in one sentence."""

import dataclasses
import json
from pathlib import Path

import pytest

from exosight.dataset.manifest import dataset_identity, read_manifest, write_manifest
from exosight.dataset.store import write_chunk
from exosight.errors import DataError, InputError
from exosight.system.camera import Camera

from .conftest import CAMERA, DESIGNS, SCHEMA, describe, designs_of, made_up


def test_round_trip(dataset: Path) -> None:
    manifest = read_manifest(dataset)
    assert manifest == describe(list(manifest.chunks))
    assert manifest.camera == CAMERA
    assert manifest.schema == SCHEMA
    assert manifest.designs == DESIGNS
    assert manifest.frames == 33
    assert manifest.dropped == {"crosses_itself": 2}


def test_every_quantity_has_a_unit_in_the_file(dataset: Path) -> None:
    quantities = json.loads((dataset / "manifest.json").read_text())["quantities"]
    assert quantities["images"]["unit"] == "gray level 0-255"
    assert all(entry["unit"] and entry["type"] and entry["meaning"] for entry in quantities.values())


def test_identity_is_that_of_what_was_made_wherever_it_was_written(dataset: Path, tmp_path: Path) -> None:
    """Another processor or HDF5 gives other bytes, and the same designs in the same division."""
    identity = dataset_identity(read_manifest(dataset))
    assert json.loads(json.dumps(identity)) == identity
    second = write_chunk(tmp_path, 1, made_up(DESIGNS[6:], seed=5))
    first = write_chunk(tmp_path, 0, made_up(DESIGNS[:6], seed=6))
    chunks = [second, first]  # in another order, on purpose
    assert dataset_identity(describe(chunks)) == identity
    others = [
        describe(chunks, seed=1),
        describe(chunks, config={"young": 2e5}),
        describe(chunks, camera=Camera(width=6, height=4, metres_per_pixel=0.1)),
        describe(chunks, schema=dataclasses.replace(SCHEMA, channels=SCHEMA.channels[::-1])),
        describe(chunks, description={"name": "bench"}),
        describe(chunks, designs=designs_of(3)),
        describe(chunks, dropped={"crosses_itself": 3}),
        describe(chunks[1:]),
    ]
    hashes = {dataset_identity(manifest)["sha256"] for manifest in others} | {identity["sha256"]}
    assert len(hashes) == 1 + len(others)


def test_a_config_with_tuples_is_the_same_from_disk(tmp_path: Path) -> None:
    manifest = describe([write_chunk(tmp_path, 0, made_up(DESIGNS))], config={"gap": (0.0, 1e-3)})
    write_manifest(tmp_path, manifest)
    assert read_manifest(tmp_path) == manifest
    assert manifest.config == {"gap": [0.0, 1e-3]}


def test_a_manifest_is_never_overwritten(dataset: Path) -> None:
    before = (dataset / "manifest.json").read_bytes()
    with pytest.raises(DataError, match="nothing is overwritten"):
        write_manifest(dataset, read_manifest(dataset))
    assert (dataset / "manifest.json").read_bytes() == before


def test_chunks_must_be_there_first(tmp_path: Path) -> None:
    chunk = write_chunk(tmp_path, 0, made_up(DESIGNS))
    (tmp_path / chunk.file).unlink()
    with pytest.raises(DataError, match=r"chunk_0000.h5: missing"):
        write_manifest(tmp_path, describe([chunk]))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"seed": -1}, "seed"),
        ({"config": {"path": Path()}}, "config must hold JSON values"),
        ({"config": {"young": float("nan")}}, "config must hold JSON values"),
        ({"system": "two words"}, "system"),
        ({"dropped": {"tip": -1}}, r"dropped\.tip"),
    ],
)
def test_a_manifest_that_json_cannot_hold_is_refused(change: dict, part: str) -> None:
    with pytest.raises(InputError, match=part):
        describe([], **change)


def test_a_manifest_without_chunks_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="lists no chunks"):
        write_manifest(tmp_path, describe([]))


def test_a_missing_folder_is_said(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such folder"):
        read_manifest(tmp_path / "nowhere")


def test_another_folder_is_no_dataset(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"not a dataset, it has no manifest\.json"):
        read_manifest(tmp_path)


def test_chunks_without_a_manifest_are_an_incomplete_dataset(dataset: Path) -> None:
    (dataset / "manifest.json").unlink()
    with pytest.raises(DataError, match="incomplete dataset"):
        read_manifest(dataset)


@pytest.mark.parametrize("keep", [0.0, 0.3, 0.999])
def test_a_truncated_manifest_is_said(dataset: Path, keep: float) -> None:
    path = dataset / "manifest.json"
    content = path.read_bytes()
    path.write_bytes(content[: int(keep * len(content))])
    with pytest.raises(DataError, match="truncated or damaged"):
        read_manifest(dataset)


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"{" * 100_000, b"[" * 100_000, b"hello"])
def test_garbage_is_said(dataset: Path, content: bytes) -> None:
    (dataset / "manifest.json").write_bytes(content)
    with pytest.raises(DataError, match="truncated or damaged"):
        read_manifest(dataset)


@pytest.mark.parametrize("content", ["[]", "{}", '{"format": "1"}', '{"format": 0}', "3", '{"format": true}'])
def test_other_json_is_no_manifest(dataset: Path, content: str) -> None:
    (dataset / "manifest.json").write_text(content)
    with pytest.raises(DataError, match=r"not a dataset of exosight|damaged manifest"):
        read_manifest(dataset)


def test_a_huge_manifest_is_not_read(dataset: Path) -> None:
    with (dataset / "manifest.json").open("ab") as file:
        file.truncate(10**9)  # sparse: takes no disk
    with pytest.raises(DataError, match="more than 64 MiB"):
        read_manifest(dataset)


def set_chunk(**change):
    return lambda values: values["chunks"][0].update(change)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda v: v.update(format=3), "dataset format 3, this exosight reads format 2; generate it again"),
        (lambda v: v.update(format=1), "dataset format 1, this exosight reads format 2; generate it again"),
        (lambda v: v.pop("seed"), "seed"),
        (lambda v: v.update(seed="0"), "seed"),
        (lambda v: v.update(extra=1), "extra"),
        (lambda v: v["camera"].update(width=10**9), "camera.width"),
        (lambda v: v["camera"].update(width=5), "its camera is not that of its schema, 6×4 pixels"),
        (lambda v: v.update(system="other"), "its system other is not that of its schema, bench"),
        (lambda v: v["schema"]["sensors"][1].update(name="P1"), "expected different names, got P1 twice"),
        (lambda v: v["schema"]["channels"][0].update(low=1), "channel push: expected a range with 0 in it"),
        (lambda v: v["schema"].update(sensors=[]), "schema.sensors"),
        (lambda v: v["camera"].update(metres_per_pixel=0), "camera.metres_per_pixel"),
        (lambda v: v.update(chunks=[]), "lists no chunks"),
        (lambda v: v["chunks"].append(v["chunks"][0]), "a chunk twice"),
        (lambda v: v.update(families=["plain"]), "is of family 1, of 1"),
        (lambda v: v["designs"][3].update(scenario=-1), "design 3 is of scenario -1, of 6"),
        (lambda v: v["designs"][1].update(number=0), "two designs alike"),
        (lambda v: v["designs"][1].update(number="1"), "designs.1.number"),
        (lambda v: v.update(dofs=10**12), "dofs"),
        (set_chunk(file="../chunk_0000.h5"), "chunks.0.file"),
        (set_chunk(file="/etc/passwd"), "chunks.0.file"),
        (set_chunk(file="sub/chunk_0000.h5"), "chunks.0.file"),
        (set_chunk(file="chunk_0000.h5\n"), "chunks.0.file"),
        (set_chunk(sha256="abc"), "chunks.0.sha256"),
        (set_chunk(frames=0), "chunks.0.frames"),
        (set_chunk(frames=10**15), "chunks.0.frames"),
    ],
)
def test_a_damaged_entry_is_one_sentence(dataset: Path, edit_manifest, change, part: str) -> None:
    edit_manifest(change)
    with pytest.raises(DataError) as caught:
        read_manifest(dataset)
    assert part in str(caught.value)
    assert "manifest.json" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_more_images_than_memory_are_refused(dataset: Path, edit_manifest) -> None:
    edit_manifest(set_chunk(frames=100_000_000, bytes=10**12))
    edit_manifest(lambda values: values["camera"].update(width=8192, height=8192))
    edit_manifest(lambda values: values["schema"]["cameras"][0].update(width=8192, height=8192))
    with pytest.raises(DataError, match="GiB of memory"):
        read_manifest(dataset)


def test_other_cameras_are_kept_exactly(tmp_path: Path) -> None:
    camera = Camera(centre=(0.1, -1 / 3), metres_per_pixel=1 / 7000, width=6, height=4)
    write_manifest(tmp_path, describe([write_chunk(tmp_path, 0, made_up(DESIGNS))], camera=camera))
    assert read_manifest(tmp_path).camera == camera
