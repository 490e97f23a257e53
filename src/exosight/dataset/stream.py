"""Fresh exosuits without end, simulated in another process while this one trains on those before.

    from exosight.dataset.stream import stream

    with stream(config, exclude=sampled_shapes(manifest)) as blocks:
        for frames in blocks:
            ...  # images, forces, u … of 11 · per_scenario shapes never seen before

Usable without JAX: only the other process imports it. As every program that starts processes, one that
streams keeps its own work under `if __name__ == "__main__":`.
"""

import multiprocessing
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import NamedTuple

import numpy as np

from exosight.dataset.config import GenerateConfig
from exosight.dataset.frames import Frames
from exosight.errors import DataError, ExosightError, InputError
from exosight.exosuit.scenarios import SampledShape, geometry, sample_shapes

STREAM = 0x57
"""Part of every seed of a stream, so that none is that of a dataset."""

PRIORITY = 5
"""How far the simulating process steps back (nice): training has the cores when both want them."""

EMPTY_BLOCKS = 10
"""Blocks without a single frame to keep after which a stream gives up."""


class _Failure(NamedTuple):
    """What ended the simulating process."""

    sentence: str


@contextmanager
def stream(
    config: GenerateConfig, *, exclude: Iterable[SampledShape] = (), start: int = 0
) -> Iterator[Iterator[Frames]]:
    """Blocks of frames of fresh shapes, for ever: 11 · config.per_scenario shapes each, less the excluded.

    config    as for a dataset; per_scenario counts the shapes of one block
    exclude   shapes that never come up, whatever their numbers: those of the datasets used for judging
    start     number of the first block; block k depends on config, `exclude` and k alone
    returns   an iterator of Frames; `shape_id` counts through the whole stream, and the shapes of one block
              are distinct

    One block waits while the next is simulated. Leaving the `with` ends the process.
    Raises DataError, from the iterator, if the simulation fails or its process is killed.
    """
    context = multiprocessing.get_context("spawn")  # a forked process would share the threads' locks
    here, there = context.Pipe(duplex=False)
    arguments = (there, config, {geometry(sampled.shape) for sampled in exclude}, start)
    process = context.Process(target=_produce, args=arguments, daemon=True, name="exosight stream")
    process.start()
    there.close()  # the process has the only other end: if it dies, reading ends
    try:
        yield _received(here)
    finally:
        here.close()
        process.terminate()
        process.join()
        process.close()


def block_shapes(
    config: GenerateConfig, number: int, excluded: set[tuple[float, bytes]]
) -> list[SampledShape]:
    """The shapes of one block of a stream: those of its own seed that are not excluded."""
    seed = int(np.random.SeedSequence((config.seed, STREAM, number)).generate_state(1, np.uint64)[0])
    drawn = sample_shapes(config.per_scenario, seed)
    fresh = [sampled for sampled in drawn if geometry(sampled.shape) not in excluded]
    return [replace(sampled, shape_id=number * len(drawn) + sampled.shape_id) for sampled in fresh]


def _received(connection: Connection) -> Iterator[Frames]:
    while True:
        try:
            block = connection.recv()
        except EOFError:
            raise DataError("stream: its process was killed; enough memory for it?") from None
        if isinstance(block, _Failure):
            raise DataError(f"stream: {block.sentence}")
        yield block


def _produce(
    connection: Connection, config: GenerateConfig, excluded: set[tuple[float, bytes]], number: int
) -> None:
    """Simulate block after block. Sending waits for the reader, so no more than one block is ahead of it."""
    os.nice(PRIORITY)
    with suppress(BrokenPipeError, KeyboardInterrupt):  # the reader has gone
        try:
            for block in _simulated(config, excluded, number):
                connection.send(block)
        except ExosightError as error:
            connection.send(_Failure(str(error)))
        except BrokenPipeError:
            raise
        except Exception as error:
            connection.send(_Failure(f"the simulation failed ({type(error).__name__}: {error})"))


def _simulated(config: GenerateConfig, excluded: set[tuple[float, bytes]], number: int) -> Iterator[Frames]:
    from exosight.dataset.simulation import simulate_shapes

    empty = 0
    while empty < EMPTY_BLOCKS:
        shapes = block_shapes(config, number, excluded)
        frames = simulate_shapes(config, shapes)[0] if shapes else ()
        empty = 0 if len(frames) else empty + 1
        if isinstance(frames, Frames) and len(frames):
            yield frames
        number += 1
    raise InputError(
        f"no frame of {EMPTY_BLOCKS} blocks is worth keeping; exclude less, or change young or gap"
    )
