"""Fresh designs without end, simulated in another process while this one trains on those before.

    from exosight.dataset.stream import stream

    with stream(config_of(manifest), 3, description=manifest.description, exclude=manifest.designs) as blocks:
        for frames in blocks:
            ...  # images, sensors, commands … of three designs of each scenario never seen before

Usable without JAX: only the other process imports it. As every program that starts processes, one that
streams keeps its own work under `if __name__ == "__main__":`.
"""

import multiprocessing
import os
from collections.abc import Hashable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

import numpy as np

from exosight.dataset.config import GenerateConfig
from exosight.dataset.frames import Frames
from exosight.errors import DataError, ExosightError, InputError
from exosight.system.design import Design

if TYPE_CHECKING:
    from exosight.system.designs import DesignSet  # needs JAX

STREAM = 0x57
"""Part of every seed of a stream, so that none is that of a dataset."""

PRIORITY = 5
"""How far the simulating process steps back (nice): training has the cores when both want them."""

EMPTY_BLOCKS = 10
"""Blocks without a single frame to keep after which a stream gives up."""


@contextmanager
def stream(
    config: GenerateConfig,
    per_scenario: int,
    *,
    description: dict[str, Any] | None = None,
    exclude: Iterable[Design] = (),
    start: int = 0,
) -> Iterator[Iterator[Frames]]:
    """Blocks of frames of fresh designs, for ever: so many of each scenario a block, less the excluded.

    config         as a dataset's; its own numbers of designs do not count
    description    entries of the system file, as the dataset's manifest holds them; None for a preset
    exclude        designs that never come up, whatever their numbers: those of the datasets used for judging
    start          number of the first block; block k depends on config, `exclude` and k alone
    returns        an iterator of Frames; `design` counts through the whole stream, and the designs of one
                   block are distinct

    One block waits while the next is simulated. Leaving the `with` ends the process.
    Raises DataError, from the iterator, if the simulation fails or its process is killed.
    """
    context = multiprocessing.get_context("spawn")  # a forked process would share the threads' locks
    here, there = context.Pipe(duplex=False)
    order = (config, description, per_scenario, tuple(exclude), start)
    process = context.Process(target=_produce, args=(there, *order), daemon=True, name="exosight stream")
    process.start()
    there.close()  # the process has the only other end: if it dies, reading ends
    try:
        yield _received(here)
    finally:
        here.close()
        process.terminate()
        process.join()
        process.close()


def block_designs(
    designs: "DesignSet", seed: int, per_scenario: int, number: int, excluded: set[Hashable]
) -> list[Design]:
    """The designs of one block of a stream: those of its own seed whose keys are not excluded."""
    own = int(np.random.SeedSequence((seed, STREAM, number)).generate_state(1, np.uint64)[0])
    drawn = designs.draw(per_scenario, own)
    fresh = [design for design in drawn if designs.key(design) not in excluded]
    return [replace(design, number=number * len(drawn) + design.number) for design in fresh]


def _received(connection: Connection) -> Iterator[Frames]:
    while True:
        try:
            block = connection.recv()
        except EOFError:
            raise DataError("stream: its process was killed; enough memory for it?") from None
        if isinstance(block, str):  # why the simulation failed
            raise DataError(f"stream: {block}")
        yield block


def _produce(connection: Connection, *order: Any) -> None:
    """Simulate block after block. Sending waits for the reader, so no more than one block is ahead of it."""
    os.nice(PRIORITY)
    with suppress(BrokenPipeError, KeyboardInterrupt):  # the reader has gone
        try:
            for block in _simulated(*order):
                connection.send(block)
        except ExosightError as error:
            connection.send(str(error))
        except BrokenPipeError:
            raise
        except Exception as error:
            connection.send(f"the simulation failed ({type(error).__name__}: {error})")


def _simulated(
    config: GenerateConfig,
    description: dict[str, Any] | None,
    per_scenario: int,
    exclude: tuple[Design, ...],
    start: int,
) -> Iterator[Frames]:
    from exosight.dataset.designs import design_set
    from exosight.dataset.simulation import simulate_designs

    designs = design_set(config, description)
    excluded = {designs.key(design) for design in exclude}
    number, empty = start, 0
    while empty < EMPTY_BLOCKS:
        chosen = block_designs(designs, config.seed, per_scenario, number, excluded)
        frames = simulate_designs(config, designs, chosen)[0] if chosen else ()
        empty = 0 if len(frames) else empty + 1
        if isinstance(frames, Frames) and len(frames):
            yield frames
        number += 1
    raise InputError(
        f"no frame of {EMPTY_BLOCKS} blocks is worth keeping; exclude less, or change stiffness or clearance"
    )
