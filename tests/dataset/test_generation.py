"""A dataset as a job: stopped and resumed, damaged and mended, made by one process or several."""

import errno
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from exosight.dataset import generation, read_frames, read_manifest
from exosight.dataset.config import GenerateConfig
from exosight.dataset.frames import Frames
from exosight.dataset.generation import generate, make_chunk
from exosight.dataset.job import GenerationJob, opened
from exosight.dataset.simulation import Solved
from exosight.errors import DataError, InputError
from exosight.system.design import Design
from exosight.system.designs import DesignSet

from .conftest import CAMERA, made_up

CONFIG = GenerateConfig(per_scenario=2, frames=3, seed=3, camera=CAMERA)
CHUNKS = 6  # of four designs each, but for the last

DROPPED = {"not_converged": 0, "crosses_itself": 2, "tip_below_finger": 1}
JOB = GenerationJob(CONFIG, None, tuple(DROPPED), 4)


def solved(
    config: GenerateConfig,
    designs: DesignSet,
    chosen: Sequence[Design],
    done: Callable[[int], None],
    kept: object,
) -> Solved:
    """In place of the solution, which takes seconds a chunk: none."""
    done(len(chosen))
    return Solved([], [], None)


def simulated(
    config: GenerateConfig, designs: DesignSet, chosen: Sequence[Design], solved: object
) -> tuple[Frames, dict[str, int]]:
    """Made-up frames of these designs."""
    seed = chosen[0].number + 1000 * config.seed
    return made_up(chosen, config.frames, seed, designs.schema), DROPPED


def without_simulation(patch: pytest.MonkeyPatch) -> None:
    """Chunks of four designs, made up."""
    patch.setattr(generation, "DESIGNS_PER_CHUNK", 4)
    patch.setattr(generation, "solve_designs", solved)
    patch.setattr(generation, "frames_of", simulated)


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    without_simulation(monkeypatch)


def contents(folder: Path) -> dict[str, str]:
    """The checksum of every file, by name."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset made without interruption."""
    folder = tmp_path_factory.mktemp("made") / "whole"
    with pytest.MonkeyPatch.context() as patch:
        without_simulation(patch)
        generate(CONFIG, folder)
    return folder


@pytest.fixture
def whole(made: Path, tmp_path: Path) -> Path:
    """A copy of it, to be damaged."""
    return Path(shutil.copytree(made, tmp_path / "whole"))


def made_numbers(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The first design of each chunk that is simulated from now on, as it is."""
    numbers = []

    def counted(config: GenerateConfig, designs: DesignSet, chosen: Sequence[Design], *rest):
        numbers.append(chosen[0].number)
        return solved(config, designs, chosen, *rest)

    monkeypatch.setattr(generation, "solve_designs", counted)
    return numbers


# The folder


def test_chunks_are_filled_in_order(whole: Path) -> None:
    manifest = read_manifest(whole)
    numbers = [chunk.designs for chunk in manifest.chunks]
    assert numbers == [tuple(range(k, min(k + 4, 22))) for k in range(0, 22, 4)]
    names = [f"chunk_000{k}.{kind}" for k in range(CHUNKS) for kind in ("h5", "json")]
    others = [".lock", "README.md", "croissant.json", "job.json", "manifest.json"]
    assert sorted(path.name for path in whole.iterdir()) == sorted(names + others)


def test_every_frame_is_kept_or_counted(whole: Path) -> None:
    manifest = read_manifest(whole)
    assert manifest.dropped == {cause: CHUNKS * count for cause, count in DROPPED.items()}
    assert manifest.frames == len(read_frames(whole)) == 22 * CONFIG.frames


def test_folder_holds_the_configuration_that_makes_it_again(whole: Path) -> None:
    manifest = read_manifest(whole)
    assert GenerateConfig(**json.loads(json.dumps(manifest.config))) == CONFIG
    assert manifest.camera == CONFIG.camera
    assert manifest.seed == CONFIG.seed


def test_equal_configurations_make_equal_files(whole: Path, tmp_path: Path) -> None:
    generate(CONFIG, tmp_path / "again")
    assert contents(tmp_path / "again") == contents(whole)


def test_chunks_of_large_images_hold_fewer_designs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(generation, "CHUNK_BYTES", 2 * CONFIG.frames * CAMERA.width * CAMERA.height)
    generate(CONFIG, tmp_path / "data")
    assert {len(chunk.designs) for chunk in read_manifest(tmp_path / "data").chunks} == {2}


def test_progress_counts_designs_and_what_was_done_before(whole: Path) -> None:
    (whole / "chunk_0001.h5").unlink()
    calls: list[tuple[int, int]] = []
    generate(CONFIG, whole, lambda done, total: calls.append((done, total)), resume=True)
    assert calls == [(18, 22), (22, 22)]


# Stopped and resumed

STOPS = ("before a chunk", "frames written, no record", "record written", "before the manifest")


@pytest.mark.parametrize("stop", STOPS)
def test_a_stopped_job_loses_the_chunk_in_flight_alone(
    stop: str, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever moment, the files end up as those of a job that was never stopped."""
    place = {
        "before a chunk": "solve_designs",
        "frames written, no record": "write_record",
        "record written": "_chunk",
        "before the manifest": "write_manifest",
    }[stop]
    original, calls = getattr(generation, place), []

    def stopped(*arguments: object, **options: object) -> object:
        calls.append(arguments)
        if len(calls) == 3 or place == "write_manifest":
            raise KeyboardInterrupt
        return original(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(generation, place, stopped)
        with pytest.raises(KeyboardInterrupt):
            generate(CONFIG, tmp_path / "data")
    with pytest.raises(DataError, match=r"incomplete dataset.*--resume"):
        read_frames(tmp_path / "data")
    numbers = made_numbers(monkeypatch)
    generate(CONFIG, tmp_path / "data", resume=True)
    assert numbers == ([] if place == "write_manifest" else [8, 12, 16, 20])
    assert contents(tmp_path / "data") == contents(whole)


KILLED = """
import os, signal, sys
from pathlib import Path
from exosight.dataset import generation
from tests.dataset import test_generation as tests
from exosight import files

generation.DESIGNS_PER_CHUNK = 4
generation.solve_designs, generation.frames_of = tests.solved, tests.simulated
written = []
real = os.fsync

def fsync(descriptor):
    written.append(descriptor)
    if len(written) == int(sys.argv[2]):
        os.kill(os.getpid(), signal.SIGKILL)
    real(descriptor)

os.fsync = fsync
generation.generate(tests.CONFIG, Path(sys.argv[1]), resume=True)
"""


def test_kill_9_while_writing_leaves_no_lock_and_no_litter(whole: Path, tmp_path: Path) -> None:
    """The process dies with a file half on disk, twice, under a temporary name."""
    folder = tmp_path / "data"
    for fsync in (7, 7):  # two a file: the second chunk, then the record of the third
        command = [sys.executable, "-c", KILLED, str(folder), str(fsync)]
        root = Path(__file__).parents[2]
        ended = subprocess.run(command, cwd=root, capture_output=True, timeout=100)
        assert ended.returncode == -signal.SIGKILL, ended.stderr.decode()
        assert not (folder / "manifest.json").exists()
    assert list(folder.glob(".*.part"))
    generate(CONFIG, folder, resume=True)
    assert contents(folder) == contents(whole)


def test_resume_needs_nothing_to_resume(whole: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for folder in (tmp_path / "new" / "data", tmp_path / "empty"):
        generate(CONFIG, folder, resume=True)
        assert contents(folder) == contents(whole)


def test_a_complete_dataset_is_left_as_it_is(whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (whole / "README.md").write_text("my own words")
    before, numbers = contents(whole), made_numbers(monkeypatch)
    generate(CONFIG, whole, resume=True)
    assert (contents(whole), numbers) == (before, [])


def test_existing_folder_is_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "note").write_text("mine")
    for resume, words in ((False, "exists already"), (True, "holds no job.json")):
        with pytest.raises(DataError, match=words):
            generate(CONFIG, tmp_path, resume=resume)
    assert [path.name for path in tmp_path.iterdir()] == ["note"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seed": 4}, r"another configuration \(seed 3 there, 4 here\)"),
        ({"young": 2e5}, r"young 300000.0 there, 200000.0 here"),
        ({"frames": 4}, r"frames 3 there, 4 here"),
        ({"camera": {"width": 7, "height": 4}}, r"width 6 there, 7 here"),
    ],
)
def test_another_configuration_is_refused(whole: Path, change: dict, words: str) -> None:
    before = contents(whole)
    with pytest.raises(InputError, match=words):
        generate(
            GenerateConfig(**{"per_scenario": 2, "frames": 3, "seed": 3, "camera": CAMERA} | change),
            whole,
            resume=True,
        )
    assert contents(whole) == before


def test_another_version_is_refused(whole: Path) -> None:
    values = json.loads((whole / "job.json").read_text())
    (whole / "job.json").write_text(json.dumps(values | {"exosight_version": "0.0.9", "unheard": 1}))
    with pytest.raises(
        InputError, match=r"begun by exosight 0\.0\.9 .*, this is .*; go on with that version"
    ):
        generate(CONFIG, whole, resume=True)


def test_a_worker_of_another_version_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"the job is one of exosight 0\.0\.9"):
        make_chunk(tmp_path, replace(JOB, exosight_version="0.0.9"), 0)


# Damaged


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-9])


def empty(path: Path) -> None:
    path.write_bytes(b"")


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def write(content: str) -> Callable[[Path], None]:
    return lambda path: path.write_text(content) and None


def from_another_job(path: Path) -> None:
    """A whole chunk with its record, of a job that differs in its seed."""
    other = path.parent.with_name("other")
    generate(GenerateConfig(per_scenario=2, frames=3, seed=4, camera=CAMERA), other)
    for name in ("chunk_0002.h5", "chunk_0002.json"):
        (path.parent / name).write_bytes((other / name).read_bytes())


def from_another_place(path: Path) -> None:
    """The chunk before and its record, copied over these."""
    for kind in ("h5", "json"):
        (path.parent / f"chunk_0002.{kind}").write_bytes((path.parent / f"chunk_0001.{kind}").read_bytes())


def forged_designs(path: Path) -> None:
    values = json.loads(path.read_text())
    values["entry"]["designs"] = [0, 1, 2, 3]
    path.write_text(json.dumps(values))


@pytest.mark.parametrize(
    ("file", "damage"),
    [
        ("chunk_0002.h5", Path.unlink),
        ("chunk_0002.h5", truncate),
        ("chunk_0002.h5", empty),
        ("chunk_0002.h5", flip),
        ("chunk_0002.h5", write("this is not HDF5")),
        ("chunk_0002.h5", from_another_job),
        ("chunk_0002.h5", from_another_place),
        ("chunk_0002.json", Path.unlink),
        ("chunk_0002.json", truncate),
        ("chunk_0002.json", write("[" * 100_000)),
        ("chunk_0002.json", write('{"job": null}')),
        ("chunk_0002.json", write(" " * 2_000_000)),
        ("chunk_0002.json", forged_designs),
    ],
)
def test_a_damaged_chunk_is_found_and_made_again(
    whole: Path, file: str, damage: Callable[[Path], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = contents(whole)
    damage(whole / file)
    numbers = made_numbers(monkeypatch)
    generate(CONFIG, whole, resume=True)
    assert numbers == [8]
    assert contents(whole) == before


@pytest.mark.parametrize("damage", [Path.unlink, truncate, empty, write("{}"), write("[" * 100_000)])
def test_a_damaged_manifest_is_written_again(whole: Path, damage: Callable[[Path], None]) -> None:
    before = contents(whole)
    damage(whole / "manifest.json")
    generate(CONFIG, whole, resume=True)
    assert contents(whole) == before


def test_while_it_is_mended_it_is_no_dataset(whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    truncate(whole / "chunk_0002.h5")

    def seen(*arguments) -> tuple[Frames, dict[str, int]]:
        with pytest.raises(DataError, match="incomplete"):
            read_manifest(whole)
        return simulated(*arguments)

    monkeypatch.setattr(generation, "frames_of", seen)
    generate(CONFIG, whole, resume=True)
    assert len(read_frames(whole)) == 22 * CONFIG.frames


@pytest.mark.parametrize("content", ["", "[1]", "{}", "nul", "[" * 100_000, " " * 9_000_000, "\x00"])
def test_a_damaged_job_is_said(whole: Path, content: str) -> None:
    (whole / "job.json").write_text(content)
    with pytest.raises(DataError, match=r"job\.json: .*not the file of a job; name a new folder"):
        generate(CONFIG, whole, resume=True)


def test_a_full_disk_is_said_and_costs_only_what_did_not_fit(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, calls = os.fsync, []

    def full(descriptor: int) -> None:
        calls.append(descriptor)
        if len(calls) > 10:  # two for the job, four for each of two chunks
            raise OSError(errno.ENOSPC, "No space left on device")
        real(descriptor)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(DataError, match=r"chunk_0002.*No space left on device.*make room.*--resume"):
            generate(CONFIG, tmp_path / "data")
    assert not list((tmp_path / "data").glob(".*.part"))
    numbers = made_numbers(monkeypatch)
    generate(CONFIG, tmp_path / "data", resume=True)
    assert numbers == [8, 12, 16, 20]
    assert contents(tmp_path / "data") == contents(whole)


# Two at once


def test_a_second_process_on_the_folder_is_refused(whole: Path) -> None:
    with (
        opened(whole, JOB, resume=True),
        pytest.raises(DataError, match="another process is working"),
    ):
        generate(CONFIG, whole, resume=True)
    generate(CONFIG, whole, resume=True)


def test_a_chunk_made_twice_does_no_harm(whole: Path) -> None:
    """A worker that was thought dead comes back."""
    (whole / "manifest.json").unlink()
    before = contents(whole)
    make_chunk(whole, JOB, 1)
    (whole / "chunk_0001.json").unlink()
    make_chunk(whole, JOB, 1)
    assert contents(whole) == before


# Refused


def test_place_that_is_no_folder_is_refused_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    for folder in (tmp_path / "file" / "data", tmp_path / "file"):
        with pytest.raises(DataError, match="cannot be made"):
            generate(CONFIG, folder, resume=True)


def test_dataset_too_large_to_be_read_again_is_refused_before_any_work(tmp_path: Path) -> None:
    config = GenerateConfig(per_scenario=100, frames=10_000)
    with pytest.raises(InputError, match=r"1100 designs with 10000 frames of 128×128 pixels take 168 GiB"):
        generate(config, tmp_path / "data")
    assert not (tmp_path / "data").exists()


def nothing(
    config: GenerateConfig, designs: DesignSet, chosen: Sequence[Design], *_
) -> tuple[Frames, dict[str, int]]:
    return made_up([], schema=designs.schema), dict(zip(DROPPED, (0, 3 * len(chosen), 0), strict=True))


def test_dataset_without_a_single_frame_is_no_dataset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(generation, "frames_of", nothing)
    with pytest.raises(InputError, match=r"no frame is worth keeping \(.*crosses itself 66"):
        generate(CONFIG, tmp_path / "data")
    with pytest.raises(DataError, match="incomplete"):
        read_manifest(tmp_path / "data")


def test_a_chunk_without_frames_is_left_out_and_not_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def first_empty(config: GenerateConfig, designs: DesignSet, chosen: Sequence[Design], *rest):
        return (nothing if chosen[0].number == 0 else simulated)(config, designs, chosen, *rest)

    monkeypatch.setattr(generation, "frames_of", first_empty)
    manifest = generate(CONFIG, tmp_path / "data")
    assert [chunk.file for chunk in manifest.chunks] == [f"chunk_000{k}.h5" for k in range(1, CHUNKS)]
    assert manifest.dropped["crosses_itself"] == 3 * 4 + 2 * (CHUNKS - 1)
    assert np.unique(read_frames(tmp_path / "data").design).tolist() == list(range(4, 22))
    numbers = made_numbers(monkeypatch)
    generate(CONFIG, tmp_path / "data", resume=True)
    assert numbers == []
