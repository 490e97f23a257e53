"""Fresh exosuits without end: new shapes, true frames, and a process that comes and goes cleanly."""

import multiprocessing
import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from exosight.dataset import simulation
from exosight.dataset import stream as streams
from exosight.dataset.config import GenerateConfig
from exosight.dataset.frames import QUANTITIES
from exosight.dataset.simulation import simulate_shapes
from exosight.dataset.stream import block_shapes, stream
from exosight.errors import DataError
from exosight.exosuit.scenarios import geometry, sample_shapes
from exosight.system.camera import Camera

from .conftest import made_up

CONFIG = GenerateConfig(
    per_scenario=1, frames=3, seed=0, camera=Camera(metres_per_pixel=0.0044, width=32, height=24)
)


# Which shapes


def test_no_block_repeats_the_dataset_of_the_same_seed_or_another_block() -> None:
    """Of the scenario `length`, with its 401 shapes, blocks may share some: it is left out here."""
    config = GenerateConfig(per_scenario=20, seed=0)
    sets = [sample_shapes(20, seed=0), *(block_shapes(config, k, set()) for k in range(3))]
    found = [geometry(each.shape) for shapes in sets for each in shapes if each.scenario > 1]
    # Two of 3721 cylinders and tapers of 10 cm may agree by chance, so that scenario is left out too.
    assert len(found) == len(set(found)) == 4 * 9 * 20


def test_excluded_shapes_never_come_up() -> None:
    config = GenerateConfig(per_scenario=60, seed=5)
    tested = sample_shapes(60, seed=7)
    excluded = {geometry(each.shape) for each in tested}
    free, all_of_them = block_shapes(config, 0, excluded), block_shapes(config, 0, set())
    assert not excluded & {geometry(each.shape) for each in free}
    assert [each for each in all_of_them if geometry(each.shape) not in excluded] == free
    # 60 of the 401 lengths are excluded, and a block of 60 holds some 9 of them.
    assert len(free) < len(all_of_them)


def test_numbers_count_through_the_stream() -> None:
    config = GenerateConfig(per_scenario=2)
    numbers = [each.shape_id for k in range(4) for each in block_shapes(config, k, set())]
    assert numbers == list(range(4 * 22))


# The process


def test_blocks_are_what_the_simulation_gives_for_their_shapes() -> None:
    with stream(CONFIG, start=4) as blocks:
        first, second = next(blocks), next(blocks)
    for frames, number in ((first, 4), (second, 5)):
        expected, _ = simulate_shapes(CONFIG, block_shapes(CONFIG, number, set()))
        for name in QUANTITIES:
            np.testing.assert_array_equal(getattr(frames, name), getattr(expected, name), err_msg=name)
    assert not multiprocessing.active_children()


def test_a_killed_process_is_said() -> None:
    with stream(CONFIG) as blocks:
        (process,) = multiprocessing.active_children()
        assert process.pid is not None
        os.kill(process.pid, signal.SIGKILL)
        with pytest.raises(DataError, match="its process was killed"):
            next(blocks)
    assert not multiprocessing.active_children()


def test_an_error_while_training_ends_the_process() -> None:
    with pytest.raises(ZeroDivisionError), stream(CONFIG):
        raise ZeroDivisionError
    assert not multiprocessing.active_children()


def test_a_stream_without_any_shape_left_says_so() -> None:
    every = [shape for k in range(streams.EMPTY_BLOCKS) for shape in block_shapes(CONFIG, k, set())]
    with (
        stream(CONFIG, exclude=every) as blocks,
        pytest.raises(DataError, match="no frame of 10 blocks is worth keeping"),
    ):
        next(blocks)


def test_what_goes_wrong_over_there_is_told_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process's own function, run here, with a simulation that fails."""

    def broken(config: GenerateConfig, shapes: list) -> None:
        raise RuntimeError("out of registers")

    monkeypatch.setattr(os, "nice", lambda by: by)
    monkeypatch.setattr(simulation, "simulate_shapes", broken)
    here, there = multiprocessing.Pipe(duplex=False)
    with here, there:
        streams._produce(there, CONFIG, set(), 0)
        with pytest.raises(DataError, match=r"simulation failed \(RuntimeError: out of registers\)"):
            next(streams._received(here))


def test_a_reader_that_has_gone_ends_the_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "nice", lambda by: by)
    monkeypatch.setattr(simulation, "simulate_shapes", lambda config, shapes: (made_up(shapes), {}))
    here, there = multiprocessing.Pipe(duplex=False)
    here.close()
    with there:
        streams._produce(there, CONFIG, set(), 0)


def test_reading_a_stream_does_not_need_jax() -> None:
    code = "import sys; from exosight.dataset.stream import stream; assert 'jax' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=100)
