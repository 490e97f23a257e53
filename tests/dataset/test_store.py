"""Chunks on disk: exact, refused when anything is wrong, and safe from what comes after."""

import hashlib
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pytest

from exosight.dataset.frames import QUANTITIES, Frames, concatenate
from exosight.dataset.manifest import write_manifest
from exosight.dataset.store import read_frames, write_chunk
from exosight.errors import DataError, InputError

from .conftest import DESIGNS, describe, made_up


def test_round_trip(dataset: Path, frames: Frames) -> None:
    read = read_frames(dataset)
    for name, quantity in QUANTITIES.items():
        assert getattr(read, name).dtype == quantity.dtype
        np.testing.assert_array_equal(getattr(read, name), getattr(frames, name))


def test_the_order_is_that_of_the_chunk_numbers(tmp_path: Path, parts: list[Frames]) -> None:
    entries = [write_chunk(tmp_path, index, part) for index, part in [(10, parts[1]), (9, parts[0])]]
    write_manifest(tmp_path, describe(entries))
    np.testing.assert_array_equal(read_frames(tmp_path).pose, concatenate(parts).pose)


def test_other_programs_see_units(dataset: Path) -> None:
    with h5py.File(dataset / "chunk_0000.h5") as file:
        assert set(file) == set(QUANTITIES)
        assert file["images"].attrs["unit"] == "gray level 0-255"
        for name in QUANTITIES:
            assert file[name].attrs["unit"]
            assert file[name].attrs["meaning"]
        assert file["images"].chunks[0] == 1  # a random frame is one block
        assert file["images"].compression == "gzip"  # MATLAB reads it without a plug-in


def test_equal_frames_make_equal_files(tmp_path: Path) -> None:
    one, other = (write_chunk(tmp_path, index, made_up(DESIGNS, seed=5)) for index in (0, 1))
    assert one.sha256 == other.sha256 == hashlib.sha256((tmp_path / one.file).read_bytes()).hexdigest()


def test_equal_frames_make_equal_files_however_long_arrays_stay_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thread that looks at frames of the stack, as Dask's profiler does, keeps what they hold open."""
    frames = made_up(DESIGNS, seed=5)
    columns = {name: np.linspace(0.0, 1.0, len(frames)) for name in ("appearance.gain", "appearance.roll")}
    one = write_chunk(tmp_path, 0, frames, columns)
    held = []
    create = h5py.Group.create_dataset

    def hold(*arguments, **options):
        held.append(create(*arguments, **options))
        return held[-1]

    monkeypatch.setattr(h5py.Group, "create_dataset", hold)
    other = write_chunk(tmp_path, 1, frames, columns)
    assert len(held) == len(QUANTITIES) + len(columns)
    assert one.sha256 == other.sha256


def test_threads_write_chunks_side_by_side(tmp_path: Path) -> None:
    frames = made_up(DESIGNS, per_design=20)
    with ThreadPoolExecutor(4) as threads:
        entries = list(threads.map(lambda number: write_chunk(tmp_path, number, frames), range(40)))
    assert len({entry.sha256 for entry in entries}) == 1


def test_the_entry_says_what_is_in_the_chunk(tmp_path: Path) -> None:
    entry = write_chunk(tmp_path, 7, made_up(DESIGNS[2:5], per_design=4))
    assert entry.file == "chunk_0007.h5"
    assert (entry.frames, entry.designs) == (12, (2, 3, 4))
    assert entry.bytes == (tmp_path / entry.file).stat().st_size


def test_unfit_frames_are_not_written(tmp_path: Path, frames: Frames) -> None:
    frames.sensors[2, 3] = np.nan
    with pytest.raises(InputError, match=r"chunk 0: sensors holds values that are not finite"):
        write_chunk(tmp_path, 0, frames)
    assert list(tmp_path.iterdir()) == []


def test_no_frames_are_not_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there are none"):
        write_chunk(tmp_path, 0, made_up([]))


def test_a_damaged_chunk_is_replaced(tmp_path: Path) -> None:
    entry = write_chunk(tmp_path, 0, made_up(DESIGNS, seed=1))
    before = (tmp_path / entry.file).read_bytes()
    (tmp_path / entry.file).write_bytes(before[:100])
    assert write_chunk(tmp_path, 0, made_up(DESIGNS, seed=1)) == entry
    assert (tmp_path / entry.file).read_bytes() == before


def test_a_complete_dataset_takes_no_more_chunks(dataset: Path) -> None:
    with pytest.raises(DataError, match="complete"):
        write_chunk(dataset, 2, made_up(DESIGNS))
    assert len(read_frames(dataset)) == 33


def test_a_failed_write_costs_only_itself(
    tmp_path: Path, parts: list[Frames], monkeypatch: pytest.MonkeyPatch
) -> None:
    first = write_chunk(tmp_path, 0, parts[0])

    def fail(source: Path, target: Path) -> None:
        raise OSError("device gone")

    with monkeypatch.context() as broken:
        broken.setattr(os, "replace", fail)
        with pytest.raises(DataError, match=r"chunk_0001\.h5: cannot be written \(device gone"):
            write_chunk(tmp_path, 1, parts[1])
    assert [path.name for path in tmp_path.iterdir()] == ["chunk_0000.h5"]
    with pytest.raises(DataError, match="incomplete dataset"):
        read_frames(tmp_path)
    write_manifest(tmp_path, describe([first, write_chunk(tmp_path, 1, parts[1])]))
    np.testing.assert_array_equal(read_frames(tmp_path).pose, concatenate(parts).pose)


def test_a_missing_chunk_is_said(dataset: Path) -> None:
    (dataset / "chunk_0001.h5").unlink()
    with pytest.raises(DataError, match=r"chunk_0001\.h5: missing"):
        read_frames(dataset)


@pytest.mark.parametrize("keep", [0, 100, -1])
def test_a_truncated_chunk_is_said(dataset: Path, keep: int) -> None:
    path = dataset / "chunk_0001.h5"
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(DataError, match=r"chunk_0001\.h5: truncated or altered"):
        read_frames(dataset)


def test_a_single_altered_bit_is_said(dataset: Path) -> None:
    path = dataset / "chunk_0000.h5"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"chunk_0000\.h5: altered"):
        read_frames(dataset)


@pytest.fixture
def swap_chunk(dataset: Path, edit_manifest):
    """Put other content in place of the first chunk and make the manifest vouch for it."""

    def swap(content: bytes) -> None:
        (dataset / "chunk_0000.h5").write_bytes(content)
        entry = {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
        edit_manifest(lambda values: values["chunks"][0].update(entry))

    return swap


@pytest.fixture
def alter_chunk(dataset: Path, swap_chunk):
    """Edit the first chunk with h5py and make the manifest vouch for it."""

    def alter(change) -> None:
        with h5py.File(dataset / "chunk_0000.h5", "a") as file:
            change(file)
        swap_chunk((dataset / "chunk_0000.h5").read_bytes())

    return alter


def replaced(name: str, values: np.ndarray):
    def change(file: h5py.File) -> None:
        del file[name]
        file[name] = values

    return change


def test_another_kind_of_file_is_said(dataset: Path, swap_chunk) -> None:
    swap_chunk(b"this is not HDF5, whatever its name says" * 400)
    with pytest.raises(DataError, match=r"chunk_0000\.h5: damaged, or not a chunk of frames"):
        read_frames(dataset)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda file: file.pop("pose"), "pose"),
        (replaced("sensors", np.zeros((18, 5))), "sensors expects float32 (18, 5), got float64 (18, 5)"),
        (
            replaced("sensors", np.zeros((18, 7), np.float32)),
            "sensors expects float32 (18, 5), got float32 (18, 7)",
        ),
        (replaced("step", np.zeros(17, np.int32)), "step expects int32 (18,), got int32 (17,)"),
        (replaced("images", np.zeros((18, 4, 7), np.uint8)), "images expects uint8 (18, 4, 6)"),
        (replaced("commands", np.full((18, 2), np.nan, np.float32)), "commands holds values that are not"),
        (replaced("commands", np.full((18, 2), 5, np.float32)), "push must lie within -1…4 N, got 5"),
        (replaced("family", np.full(18, 2, np.int8)), "carry another family or scenario"),
        (replaced("design", np.full(18, 3, np.int32)), "other designs than the manifest says"),
    ],
)
def test_content_that_contradicts_the_manifest_is_said(dataset: Path, alter_chunk, change, part: str) -> None:
    alter_chunk(change)
    with pytest.raises(DataError) as caught:
        read_frames(dataset)
    assert part in str(caught.value)
    assert "chunk_0000.h5" in str(caught.value)


def test_a_design_that_the_manifest_does_not_list_is_said(dataset: Path, edit_manifest) -> None:
    edit_manifest(lambda values: values["designs"].pop(2))
    with pytest.raises(DataError, match="lists no design 2"):
        read_frames(dataset)


def test_a_chunk_that_points_at_another_file_is_refused(dataset: Path, tmp_path: Path, alter_chunk) -> None:
    secret = tmp_path / "secret"
    secret.write_bytes(bytes(18 * 4 * 6))

    def point_outside(file: h5py.File) -> None:
        del file["images"]
        file.create_dataset("images", (18, 4, 6), np.uint8, external=[(str(secret), 0, h5py.h5f.UNLIMITED)])

    alter_chunk(point_outside)
    with pytest.raises(DataError, match="images is not an array of this file"):
        read_frames(dataset)


def test_a_chunk_that_links_to_an_array_of_another_file_is_refused(
    dataset: Path, tmp_path: Path, alter_chunk
) -> None:
    with h5py.File(tmp_path / "secret.h5", "w") as secret:
        secret["images"] = np.zeros((18, 4, 6), np.uint8)

    def link_outside(file: h5py.File) -> None:
        del file["images"]
        file["images"] = h5py.ExternalLink(str(tmp_path / "secret.h5"), "images")

    alter_chunk(link_outside)
    with pytest.raises(DataError, match="images is missing, or a link"):
        read_frames(dataset)


def test_a_promise_of_more_frames_than_there_are_is_refused(dataset: Path, edit_manifest) -> None:
    edit_manifest(lambda values: values["chunks"][0].update(frames=10_000_000))
    with pytest.raises(DataError, match=r"chunk_0000\.h5 cannot hold 10000000 frames"):
        read_frames(dataset)
