"""Fresh designs without end: new ones, true frames, and a process that comes and goes cleanly."""

import multiprocessing
import os
import signal
import subprocess
import sys

import pytest

from exosight.dataset import simulation
from exosight.dataset import stream as streams
from exosight.dataset.config import GenerateConfig
from exosight.dataset.designs import design_set
from exosight.dataset.stream import block_designs, stream
from exosight.errors import DataError
from exosight.system.camera import Camera

from .conftest import made_up

# Stiffer than silicone, so that nothing snaps: a tenth of the solver's steps.
CONFIG = GenerateConfig(
    frames=3, seed=0, young=1e6, camera=Camera(metres_per_pixel=0.0044, width=32, height=24)
)
SET = design_set(CONFIG, None)


# Which designs


def test_no_block_repeats_the_dataset_of_the_same_seed_or_another_block() -> None:
    """Of the scenario `length`, with its 401 shapes, blocks may share some: it is left out here."""
    sets = [SET.draw(20, seed=0), *(block_designs(SET, 0, 20, k, set()) for k in range(3))]
    found = [SET.key(each) for designs in sets for each in designs if each.scenario > 1]
    # Two of 3721 cylinders and tapers of 10 cm may agree by chance, so that scenario is left out too.
    assert len(found) == len(set(found)) == 4 * 9 * 20


def test_excluded_designs_never_come_up() -> None:
    excluded = {SET.key(each) for each in SET.draw(60, seed=7)}
    free, all_of_them = block_designs(SET, 5, 60, 0, excluded), block_designs(SET, 5, 60, 0, set())
    assert not excluded & {SET.key(each) for each in free}
    assert [each for each in all_of_them if SET.key(each) not in excluded] == free
    # 60 of the 401 lengths are excluded, and a block of 60 holds some 9 of them.
    assert len(free) < len(all_of_them)


def test_numbers_count_through_the_stream() -> None:
    numbers = [each.number for k in range(4) for each in block_designs(SET, 0, 2, k, set())]
    assert numbers == list(range(4 * 22))


# The process

ORDER = (CONFIG, None, 1, (), 0)


def test_a_killed_process_is_said() -> None:
    with stream(CONFIG, 1) as blocks:
        (process,) = multiprocessing.active_children()
        assert process.pid is not None
        os.kill(process.pid, signal.SIGKILL)
        with pytest.raises(DataError, match="its process was killed"):
            next(blocks)
    assert not multiprocessing.active_children()


def test_an_error_while_training_ends_the_process() -> None:
    with pytest.raises(ZeroDivisionError), stream(CONFIG, 1):
        raise ZeroDivisionError
    assert not multiprocessing.active_children()


def test_a_stream_without_any_design_left_says_so() -> None:
    every = [each for k in range(streams.EMPTY_BLOCKS) for each in block_designs(SET, 0, 1, k, set())]
    with (
        stream(CONFIG, 1, exclude=every) as blocks,
        pytest.raises(DataError, match="no frame of 10 blocks is worth keeping"),
    ):
        next(blocks)


def test_what_goes_wrong_over_there_is_told_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process's own function, run here, with a simulation that fails."""

    def broken(*_) -> None:
        raise RuntimeError("out of registers")

    monkeypatch.setattr(os, "nice", lambda by: by)
    monkeypatch.setattr(simulation, "simulate_designs", broken)
    here, there = multiprocessing.Pipe(duplex=False)
    with here, there:
        streams._produce(there, *ORDER)
        with pytest.raises(DataError, match=r"simulation failed \(RuntimeError: out of registers\)"):
            next(streams._received(here))


def test_a_reader_that_has_gone_ends_the_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "nice", lambda by: by)
    monkeypatch.setattr(simulation, "simulate_designs", lambda _, designs, chosen: (made_up(chosen), {}))
    here, there = multiprocessing.Pipe(duplex=False)
    here.close()
    with there:
        streams._produce(there, *ORDER)


def test_reading_a_stream_does_not_need_jax() -> None:
    code = "import sys; from exosight.dataset.stream import stream; assert 'jax' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=100)
