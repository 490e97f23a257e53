"""A dataset from simulation: the way each design is driven, what is left out, and what is stored."""

from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from exosight.dataset import direction, generation, read_frames, read_manifest, solved
from exosight.dataset.config import GenerateConfig
from exosight.dataset.designs import design_set
from exosight.dataset.frames import QUANTITIES, Frames, take
from exosight.dataset.generation import generate
from exosight.dataset.load_paths import WAYPOINTS, load_path
from exosight.dataset.manifest import Manifest
from exosight.dataset.simulation import causes, crosses_itself, first_cause, simulate_designs
from exosight.mechanics import potential
from exosight.mechanics.batched_continuation import Solutions
from exosight.system.camera import Camera
from exosight.system.observation import Observation, observe
from exosight.system.system import stack_systems
from exosight.vision.scene import picture

from .conftest import SCHEMA

CONFIG = GenerateConfig(
    per_scenario=1,
    frames=5,
    seed=3,
    young=8e5,  # of silicone's 3e5 more wind up, at three times the solver's steps
    camera=Camera(metres_per_pixel=0.0044, width=32, height=24),
)
SET = design_set(CONFIG, None)
CAUSES = ("not_converged", "crosses_itself", "tip_below_finger")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of 11 designs and 5 frames each, in chunks of 6 and 5 designs."""
    folder = tmp_path_factory.mktemp("generated") / "data"
    calls = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generation, "DESIGNS_PER_CHUNK", 6)
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
def test_the_path_of_one_channel_turns_at_its_peak(frames: int) -> None:
    path = load_path(SET.schema, frames, 0, 0)
    loads = path.commands[:, 0]
    assert loads[0] == loads[-1] == 0
    assert loads.max() == 4
    np.testing.assert_array_equal(loads, loads[::-1])
    assert len(loads) <= frames + 1


@given(frames=st.integers(2, 600))
def test_frames_lie_evenly_along_the_way(frames: int) -> None:
    """0 → 4 → 0 N is 8 N long: frame k stands 8 k / (frames − 1) along it."""
    path = load_path(SET.schema, frames, 0, 0)
    way = np.concatenate([[0], np.cumsum(np.abs(np.diff(path.commands[:, 0])))])
    np.testing.assert_allclose(way[path.frames], np.linspace(0, 8, frames), atol=1e-11)


@given(frames=st.integers(2, 300), seed=st.integers(0, 2**60), number=st.integers(0, 2**30))
def test_several_channels_go_from_rest_to_rest_within_their_ranges(
    frames: int, seed: int, number: int
) -> None:
    path = load_path(SCHEMA, frames, seed, number)
    low, high = SCHEMA.limits
    assert np.all((path.commands >= low) & (path.commands <= high))
    assert np.all(path.commands[[0, -1]] == 0)
    assert len(path.frames) == frames
    assert np.all(np.diff(path.frames) > 0)
    again = load_path(SCHEMA, frames, seed, number)
    np.testing.assert_array_equal(path.commands, again.commands)


def test_between_waypoints_the_way_is_straight_and_even() -> None:
    """Eleven frames a piece: second differences vanish but at the four waypoints."""
    frames = 10 * (WAYPOINTS + 1) + 1
    path = load_path(SCHEMA, frames, 1, 7)
    bend = np.abs(np.diff(path.commands[path.frames], 2, axis=0)).max(axis=1)
    waypoints = np.arange(9, frames - 2, 10)
    assert np.all(bend[waypoints] > 1e-3)
    assert np.all(np.delete(bend, waypoints) < 1e-12)  # round-off of commands of some tens


def test_waypoints_are_even_over_the_ranges_and_differ_from_design_to_design() -> None:
    """With ten frames a piece the waypoints themselves are frames."""
    frames = 10 * (WAYPOINTS + 1) + 1
    paths = [load_path(SCHEMA, frames, 0, number) for number in range(300)]
    at = np.concatenate([path.commands[path.frames][10:-10:10] for path in paths])
    low, high = SCHEMA.limits
    share = (at - low) / (high - low)
    assert len(np.unique(at, axis=0)) == 300 * WAYPOINTS
    error = np.sqrt(1 / 12 / len(share))
    np.testing.assert_allclose(share.mean(axis=0), 0.5, atol=5 * error)  # five standard errors
    assert abs(np.corrcoef(share.T)[0, 1]) < 5 / np.sqrt(len(share))


def test_paths_of_two_and_three_frames() -> None:
    for frames, kept in ((2, [0, 0]), (3, [0, 4, 0])):
        path = load_path(SET.schema, frames, 0, 0)
        np.testing.assert_array_equal(path.commands[path.frames][:, 0], kept)


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


def with_axes(finger: np.ndarray, exosuit: np.ndarray) -> Observation:
    """Nothing but where the tubes are (1, frames, points, 3)."""
    batch = exosuit.shape[:2]
    none = np.zeros((*batch, 0, 3))
    return Observation(np.zeros((*batch, 0)), none, none, none, {"finger": finger, "exosuit": exosuit})


def test_first_cause_wins() -> None:
    """Four frames: all three causes, crossing and low tip, low tip alone, none."""
    straight, bow = polyline((0, 0), (1, 0), (2, 1), (3, 1)), polyline((0, 0), (2, 2), (2, 0), (0, 2))
    line = np.stack([np.concatenate([bow, bow, straight, straight])])
    finger = np.zeros((1, 4, 5, 3))
    finger[0, :, -1, 2] = [5, 5, 5, 0]
    seen = with_axes(finger, line)
    system = SET.build(SET.draw(1, 0)[0])
    converged = np.array([[False, True, True, True]])
    names = (*causes(SET), None)
    found = [names[i] for i in first_cause(SET, system, converged, seen)[0]]
    assert found == [*CAUSES, None]


def test_a_finger_that_is_crossed_is_no_rod() -> None:
    """Links may be seen to cross: what is checked is the axis of rods."""
    bow, straight = polyline((0, 0), (2, 2), (2, 0), (0, 2)), polyline((0, 0), (1, 0), (2, 3), (3, 3))
    seen = with_axes(bow[None], straight[None])
    system = SET.build(SET.draw(1, 0)[0])
    assert first_cause(SET, system, np.ones((1, 1), bool), seen).tolist() == [[len(CAUSES)]]


def test_every_frame_is_kept_or_counted(manifest: Manifest, frames: Frames) -> None:
    assert len(manifest.designs) == 11
    assert tuple(manifest.dropped) == CAUSES
    assert len(frames) + sum(manifest.dropped.values()) == 11 * CONFIG.frames
    assert manifest.dropped["not_converged"] == 0
    assert 0 < manifest.dropped["crosses_itself"] < 30  # thin exosuits wind up at 4 N, thick ones do not


def test_no_stored_frame_is_one_to_be_left_out(manifest: Manifest, frames: Frames) -> None:
    for number in np.unique(frames.design).tolist():
        seen = observed(manifest, frames, number)
        fine = np.ones(seen.readings.shape[:2], dtype=bool)
        system = SET.build(manifest.designs[number])
        assert np.all(first_cause(SET, system, fine, seen) == len(CAUSES))


# What is stored


def observed(manifest: Manifest, frames: Frames, number: int) -> Observation:
    """What is seen (1, frames of this design, …) at the stored coordinates, one by one."""
    systems = stack_systems([SET.build(manifest.designs[number])])
    found = [observe(systems, q[None, None]) for q in frames.pose[frames.design == number]]
    return jax.tree.map(lambda *leaves: np.concatenate(leaves, axis=1), *found)


def test_labels_and_images_follow_from_the_stored_poses(manifest: Manifest, frames: Frames) -> None:
    for number in np.unique(frames.design).tolist():
        mine = frames.design == number
        seen = observed(manifest, frames, number)
        # Sensors are stored as float32: seven digits.
        np.testing.assert_allclose(frames.sensors[mine], seen.readings[0], rtol=1e-6, atol=1e-9)
        axes = {name: axis[0] for name, axis in seen.axes.items()}
        images = picture(SET.build(manifest.designs[number]), axes)
        np.testing.assert_array_equal(frames.images[mine], images)
    np.testing.assert_array_equal(frames.labels, frames.sensors[:, 1:8])  # of C0…C7 all but the first


def test_every_frame_is_an_equilibrium(manifest: Manifest, frames: Frames) -> None:
    """None is interpolated: forces balance to 1e-8 of the elastic ones.

    The solver stops at 1e-10 in its own norm, of which soft modes make up to a hundred times as much; the
    loads of five frames are stored without rounding.
    """
    balance = jax.jit(lambda robot, q, u: potential(robot)(q, u)[0].gradient)
    for q, commands, number in zip(frames.pose, frames.commands, frames.design, strict=True):
        system = SET.build(manifest.designs[number])
        loads = system.loads(commands)
        residual = np.abs(balance(system.robot, q, loads))
        unbalanced = np.abs(balance(system.robot, 0.9 * q, loads))
        assert residual.max() <= 1e-8 * max(unbalanced.max(), 1e-3)


def test_loads_steps_and_direction(manifest: Manifest, frames: Frames) -> None:
    """Of each design a subset, in order, of 0, 2, 4 N rising and 2, 0 N falling."""
    whole = [(0, 0), (2, 1), (4, 2), (2, 3), (0, 4)]
    way = direction(frames)
    for number in range(11):
        mine = frames.design == number
        rows = list(zip(frames.commands[mine, 0].tolist(), frames.step[mine].tolist(), strict=True))
        assert rows == [row for row in whole if row in rows]
        if (4, 2) in rows:
            np.testing.assert_array_equal(way[mine] > 0, frames.step[mine] <= 2)


def assert_same(made: Frames, expected: Frames) -> None:
    """To the last bit."""
    for name in QUANTITIES:
        np.testing.assert_array_equal(getattr(made, name), getattr(expected, name), err_msg=name)


def test_same_seed_same_frames_whatever_designs_share_their_chunk(manifest: Manifest, frames: Frames) -> None:
    """The five designs in the middle, simulated once more across the border of the two chunks."""
    again, dropped = simulate_designs(CONFIG, SET, manifest.designs[3:8])
    same = take(frames, np.flatnonzero((frames.design >= 3) & (frames.design < 8)))
    assert len(again) + sum(dropped.values()) == 5 * CONFIG.frames
    assert_same(again, same)


@pytest.mark.parametrize("damage", [False, True])
def test_a_stop_within_a_chunk_keeps_the_designs_that_are_solved(
    damage: bool, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are not solved again, and the files are those of a run without a stop."""
    monkeypatch.setattr(generation, "DESIGNS_PER_CHUNK", 6)
    monkeypatch.setattr(solved, "SAVE_SECONDS", 0.0)

    def stop(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate(CONFIG, tmp_path / "data", stop)
    (file,) = (tmp_path / "data").glob("*.npz")
    with np.load(file) as content:
        kept = len(content["numbers"])
    if damage:
        file.write_bytes(file.read_bytes()[:-1000] + bytes(1000))
    numbers, finished = [], solved.SolvedDesigns.finished

    def counted(self: solved.SolvedDesigns, number: int, found: Solutions) -> None:
        numbers.append(number)
        finished(self, number, found)

    monkeypatch.setattr(solved.SolvedDesigns, "finished", counted)
    generate(CONFIG, tmp_path / "data", resume=True)
    assert kept > 0
    assert len(numbers) == 11 - (0 if damage else kept)
    names = {path.name for path in folder.iterdir()}
    assert {path.name for path in (tmp_path / "data").iterdir()} == names
    for name in names:
        assert (tmp_path / "data" / name).read_bytes() == (folder / name).read_bytes(), name


def test_another_seed_gives_other_designs(manifest: Manifest) -> None:
    assert not {SET.key(each) for each in SET.draw(1, seed=4)} & {SET.key(each) for each in manifest.designs}
