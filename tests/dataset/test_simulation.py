"""A dataset from simulation: the way each shape is driven, what is left out, and what is stored."""

from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from exosight.dataset import generation, read_frames, read_manifest, sampled_shapes
from exosight.dataset.config import GenerateConfig
from exosight.dataset.frames import CAUSES, QUANTITIES, Frames, take
from exosight.dataset.generation import generate
from exosight.dataset.job import ChunkRecord, GenerationJob
from exosight.dataset.manifest import Manifest
from exosight.dataset.simulation import (
    crosses_itself,
    exosuit_of,
    first_cause,
    load_path,
    simulate_shapes,
)
from exosight.exosuit.assembly import Pose, assemble, observe
from exosight.exosuit.scenarios import sample_shapes
from exosight.mechanics import potential, stack
from exosight.system.camera import Camera
from exosight.vision.scene import picture

CONFIG = GenerateConfig(
    per_scenario=1, frames=5, seed=3, camera=Camera(metres_per_pixel=0.0044, width=32, height=24)
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of 11 shapes and 5 frames each, in chunks of 6 and 5 shapes."""
    folder = tmp_path_factory.mktemp("generated") / "data"
    calls = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generation, "SHAPES_PER_CHUNK", 6)
        generate(CONFIG, folder, lambda done, total: calls.append((done, total)))
    assert calls[0] == (0, 11)
    assert calls[-1] == (11, 11)
    assert calls == sorted(calls)
    return folder


@pytest.fixture(scope="module")
def manifest(folder: Path) -> Manifest:
    return read_manifest(folder)


@pytest.fixture(scope="module")
def frames(folder: Path) -> Frames:
    return read_frames(folder)


# The way


@given(frames=st.integers(2, 600))
def test_every_path_turns_at_four_newtons(frames: int) -> None:
    loads, keep = load_path(frames)
    assert loads[0] == loads[-1] == 0
    assert loads.max() == 4
    np.testing.assert_allclose(loads, loads[::-1], atol=1e-12)  # round-off of the division
    assert len(loads[keep]) == frames


@given(frames=st.integers(2, 600))
def test_frames_lie_evenly_along_the_way(frames: int) -> None:
    """0 → 4 → 0 N is 8 N long: frame k stands 8 k / (frames − 1) along it."""
    loads, keep = load_path(frames)
    way = np.concatenate([[0], np.cumsum(np.abs(np.diff(loads)))])
    np.testing.assert_allclose(way[keep], np.linspace(0, 8, frames), atol=1e-11)


def test_paths_of_two_and_three_frames() -> None:
    for frames, kept in ((2, [0, 0]), (3, [0, 4, 0])):
        loads, keep = load_path(frames)
        np.testing.assert_array_equal(loads[keep], kept)


# What is left out


def polyline(*points: tuple[float, float]) -> np.ndarray:
    """One frame of points (x, z), at depths y that must not matter."""
    line = np.array(points, dtype=float)
    depth = np.arange(len(line)) ** 2 % 7
    return np.stack([line[:, 0], depth, line[:, 1]], axis=1)[None]


@pytest.mark.parametrize(
    ("crosses", "points"),
    [
        (False, [(0, 0), (1, 0), (2, 0)]),
        (False, [(0, 0), (1, 0), (1, 1), (0, 1)]),
        (False, [(0, 0), (3, 0), (3, 3), (1, 3), (1, 1), (2, 1)]),  # a spiral inwards
        (True, [(0, 0), (2, 2), (2, 0), (0, 2)]),  # a bow tie
        (True, [(0, 0), (4, 0), (4, 2), (2, 2), (2, -1)]),  # a loop
    ],
)
def test_known_lines_cross_themselves_or_not(crosses: bool, points: list[tuple[float, float]]) -> None:
    assert crosses_itself(polyline(*points)).tolist() == [crosses]


# Whole numbers, so that moving a line moves it exactly and touching lines touch as before.
Lines = arrays(np.int64, st.tuples(st.just(3), st.integers(3, 12), st.just(2)), elements=st.integers(-9, 9))


@given(lines=Lines, shift=st.tuples(st.integers(-50, 50), st.integers(-50, 50)), quarters=st.integers(0, 3))
def test_crossing_is_left_alone_by_motions_reversal_and_batching(
    lines: np.ndarray, shift: tuple[int, int], quarters: int
) -> None:
    line = np.concatenate([polyline(*each) for each in lines.tolist()])
    found = crosses_itself(line)
    turn = np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), quarters)
    moved = lines @ turn.T + np.array(shift)
    np.testing.assert_array_equal(crosses_itself(line[:, ::-1]), found)
    np.testing.assert_array_equal(
        crosses_itself(np.concatenate([polyline(*each) for each in moved.tolist()])), found
    )
    np.testing.assert_array_equal(np.concatenate([crosses_itself(each[None]) for each in line]), found)


def test_first_cause_wins() -> None:
    """Four frames: all three causes, crossing and low tip, low tip alone, none."""
    straight, bow = polyline((0, 0), (1, 0), (2, 1), (3, 1)), polyline((0, 0), (2, 2), (2, 0), (0, 2))
    line = np.stack([np.concatenate([bow, bow, straight, straight])])
    finger = np.zeros((1, 4, 5, 3))
    finger[0, :, -1, 2] = [5, 5, 5, 0]
    pose = Pose(
        forces=np.zeros((1, 4, 8)),
        net_force=np.zeros((1, 4)),
        pushes=np.zeros((1, 4, 8, 3)),
        spheres=np.zeros((1, 4, 8, 3)),
        joint_angles=np.zeros((1, 4, 3)),
        centreline=line,
        finger=finger,
        tip_angle=np.zeros((1, 4)),
    )
    converged = np.array([[False, True, True, True]])
    causes = (*CAUSES, None)
    found = [causes[i] for i in first_cause(converged, pose)[0]]
    assert found == ["not_converged", "crosses_itself", "tip_below_finger", None]


def test_every_frame_is_kept_or_counted(manifest: Manifest, frames: Frames) -> None:
    assert len(manifest.shapes) == 11
    assert set(manifest.dropped) == set(CAUSES)
    assert len(frames) + sum(manifest.dropped.values()) == 11 * CONFIG.frames
    assert manifest.dropped["not_converged"] == 0
    assert 0 < manifest.dropped["crosses_itself"] < 30  # thin exosuits wind up at 4 N, thick ones do not


def test_no_stored_frame_is_one_to_be_left_out(manifest: Manifest, frames: Frames) -> None:
    for number in np.unique(frames.shape_id):
        pose = poses(manifest, frames, number)
        assert np.all(first_cause(np.ones(pose.net_force.shape, dtype=bool), pose) == len(CAUSES))


# What is stored


def poses(manifest: Manifest, frames: Frames, number: int) -> Pose:
    """The poses (1, frames of this shape, …) that follow from the stored coordinates."""
    robots = stack([assemble(exosuit_of(CONFIG, sampled_shapes(manifest)[number].shape))])
    found = [observe(robots, q[None, None]) for q in frames.pose[frames.shape_id == number]]
    return jax.tree.map(lambda *leaves: np.concatenate(leaves, axis=1), *found)


def test_labels_and_images_follow_from_the_stored_poses(manifest: Manifest, frames: Frames) -> None:
    for number in np.unique(frames.shape_id):
        mine = frames.shape_id == number
        pose = poses(manifest, frames, number)
        # Forces are stored as float32: seven digits.
        np.testing.assert_allclose(frames.forces[mine], pose.forces[0, :, 1:], rtol=1e-6, atol=1e-9)
        exosuit = exosuit_of(CONFIG, sampled_shapes(manifest)[number].shape)
        images = picture(exosuit, jax.tree.map(lambda leaf: leaf[0], pose), CONFIG.camera)
        np.testing.assert_array_equal(frames.images[mine], images)


def test_every_frame_is_an_equilibrium(manifest: Manifest, frames: Frames) -> None:
    """None is interpolated: forces balance to 1e-9 of the elastic ones.

    The solver stops at 1e-10 in its own norm; the loads of five frames are stored without rounding.
    """
    shapes = sampled_shapes(manifest)
    balance = jax.jit(lambda robot, q, u: potential(robot)(q, u)[0].gradient)
    for q, u, number in zip(frames.pose, frames.u, frames.shape_id, strict=True):
        robot = assemble(exosuit_of(CONFIG, shapes[number].shape))
        residual = np.abs(balance(robot, q, np.array([u], dtype=float)))
        unbalanced = np.abs(balance(robot, 0.9 * q, np.array([u], dtype=float)))
        assert residual.max() <= 1e-9 * max(unbalanced.max(), 1e-3)


def test_loads_and_direction_of_loading(manifest: Manifest, frames: Frames) -> None:
    """Of each shape a subset, in order, of 0, 2, 4 N rising and 2, 0 N falling."""
    whole = [(0, 1), (2, 1), (4, 1), (2, -1), (0, -1)]
    for number in range(11):
        mine = frames.shape_id == number
        rows = list(zip(frames.u[mine].tolist(), frames.loading[mine].tolist(), strict=True))
        assert rows == [row for row in whole if row in rows]


def assert_same(made: Frames, expected: Frames) -> None:
    """To the last bit."""
    for name in QUANTITIES:
        np.testing.assert_array_equal(getattr(made, name), getattr(expected, name), err_msg=name)


def test_same_seed_same_frames_whatever_shapes_share_their_chunk(frames: Frames) -> None:
    """The five shapes in the middle, simulated once more across the border of the two chunks."""
    again, dropped = simulate_shapes(CONFIG, sample_shapes(CONFIG.per_scenario, CONFIG.seed)[3:8])
    same = take(frames, np.flatnonzero((frames.shape_id >= 3) & (frames.shape_id < 8)))
    assert len(again) + sum(dropped.values()) == 5 * CONFIG.frames
    assert_same(again, same)


def test_processes_of_which_one_is_killed_at_work_make_the_same_files(
    folder: Path, frames: Frames, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two workers; the one with the first chunk is killed when its first shape is done."""
    pytest.importorskip("distributed")
    killed = tmp_path / "killed"

    def dies_once(place: Path, job: GenerationJob, number: int) -> ChunkRecord:
        import os
        import signal

        from exosight.dataset.generation import make_chunk

        def die(shapes_done: int) -> None:
            if number == 0 and not killed.exists():
                killed.touch()
                os.kill(os.getpid(), signal.SIGKILL)

        return make_chunk(place, job, number, die)

    monkeypatch.setattr(generation, "SHAPES_PER_CHUNK", 6)
    monkeypatch.setattr(generation, "make_chunk", dies_once)
    generate(CONFIG, tmp_path / "data", workers=2)
    assert killed.exists()
    assert_same(read_frames(tmp_path / "data"), frames)  # first, as it says how far off they are
    names = {path.name for path in folder.iterdir()}
    assert {path.name for path in (tmp_path / "data").iterdir()} == names
    for name in names:
        assert (tmp_path / "data" / name).read_bytes() == (folder / name).read_bytes(), name


def test_another_seed_gives_other_shapes(manifest: Manifest) -> None:
    assert sample_shapes(1, seed=4) != sampled_shapes(manifest)
