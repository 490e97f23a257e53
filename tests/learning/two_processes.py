"""A program for `test_parallel.py`: runs of two processes, forked from one with PyTorch loaded.

    python two_processes.py FOLDER

FOLDER holds `samples.npz`. Each function below is a run; what each of its processes says on stderr goes to
`NAME.RANK.txt`, its exit code comes on stdout as one line `NAME RANK CODE`.
"""

import os
import signal
import sys
import traceback
import weakref
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
import torch._dynamo  # as the first optimiser in a process does, which takes a second
import torch.distributed as dist
from schemas import published_schema
from torch import nn
from torch.distributed import TCPStore

from exosight.errors import ExosightError, InputError
from exosight.learning import FrameBlock, TrainConfig, TrainingData, train, training
from exosight.learning.checkpoint import RunIdentity
from exosight.learning.networks import Network
from exosight.learning.parallel import join
from exosight.learning.process_group import ProcessGroup
from exosight.learning.training_data import FrameBlocks

Work = Callable[[ProcessGroup, TrainingData, Path], None]

MODERN = TrainConfig(epochs=3, batch=16, threads=1, seed=5, precision="float32")
CLEAN = replace(MODERN, recipe="clean", batch=13)


def plain_network(identity: RunIdentity):
    """One hidden layer, without batch normalisation, from the run's seed."""
    with torch.random.fork_rng():
        torch.manual_seed(identity.settings.seed)
        outputs = 21 + len(identity.auxiliary_scale)
        return Network(7, nn.Flatten(), nn.Linear(1600, 32), nn.ReLU(), nn.Linear(32, outputs))


def blocks(samples: TrainingData):
    """Ten simulated frames for each epoch: those of validation, mirrored and shifted."""

    def produce(first: int) -> Iterator[FrameBlock]:
        kept = samples.validation_index[:10]
        while True:
            first += 1
            images = np.roll(samples.images[kept, ::-1], first, axis=2).copy()
            alone = np.arange(len(kept))
            yield FrameBlock(
                images, samples.labels[kept], samples.auxiliary[kept], np.float32(alone)[:, None], alone
            )

    return produce


def whole(group: ProcessGroup, samples: TrainingData, folder: Path) -> None:
    run(group, samples, folder / "whole", MODERN)


def killed(group: ProcessGroup, samples: TrainingData, folder: Path) -> None:
    def kill(progress) -> None:
        if progress.step == 7:
            os.kill(os.getpid(), signal.SIGKILL)

    run(group, samples, folder / "killed", MODERN, progress=kill)


def resumed(group: ProcessGroup, samples: TrainingData, folder: Path) -> None:
    run(group, samples, folder / "killed", MODERN, resume=True)


def plain(group: ProcessGroup, samples: TrainingData, folder: Path) -> None:
    RunIdentity.build_network = plain_network
    online_blocks = blocks(samples) if group.first else unwanted
    name = f"plain{group.size}" if group.first else f"plain{group.size}_second"
    run(group, samples, folder / name, CLEAN, online_blocks=online_blocks)


def unwanted(first: int):
    raise AssertionError("only the first process makes fresh frames")


def failed(group: ProcessGroup, samples: TrainingData, folder: Path) -> None:
    step, steps = training._step, iter(range(6))

    def until_the_sixth(*arguments) -> float:
        if next(steps) == 5:
            raise InputError("the sixth step is one too many")
        return step(*arguments)

    if not group.first:
        training._step = until_the_sixth
    run(group, samples, folder / "failed", MODERN)


def at_odds(group: ProcessGroup, samples: TrainingData, folder: Path) -> None:
    run(group, samples, folder / "at_odds", replace(MODERN, seed=group.rank))


def too_small(group: ProcessGroup, samples: TrainingData, folder: Path) -> None:
    few = replace(samples, train_index=samples.train_index[:3])
    run(group, few, folder / "too_small", MODERN)


def run(
    group: ProcessGroup,
    samples: TrainingData,
    folder: Path,
    config: TrainConfig,
    online_blocks: FrameBlocks | None = None,
    **options,
) -> None:
    train(config, replace(samples, online_blocks=online_blocks), folder, group=group, **options)


TWO = (whole, killed, resumed, plain, failed, at_odds, too_small)
RUNS = (*((work, 2) for work in TWO), (plain, 1))


def process(work: Work, rank: int, size: int, port: int, folder: Path) -> int:
    """What one process does; returns its exit code."""
    ranks = {
        **{"RANK": str(rank), "LOCAL_RANK": str(rank)},
        **{"WORLD_SIZE": str(size), "LOCAL_WORLD_SIZE": str(size)},
    }
    torchrun = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port), "TORCHELASTIC_USE_AGENT_STORE": "True"}
    os.environ |= ranks | torchrun
    with np.load(folder / "samples.npz") as stored:
        samples = TrainingData(
            schema=published_schema(40, 40),
            identity={"camera": "512 px/m"},
            auxiliary_units=("N", "N"),
            **stored,
        )
    try:
        with join("cpu") as group:
            world = weakref.ref(dist.group.WORLD) if size > 1 else None
            work(group, samples, folder)
        if world and world():  # its threads, alive at the end of Python, now and then ended it by an abort
            return 3
    except ExosightError as error:
        print(error, file=sys.stderr)
        return 2
    except SystemExit as leaving:
        return int(leaving.code or 0)
    return 0


def fork(work: Work, rank: int, size: int, port: int, folder: Path) -> int:
    """Start one process; returns its number."""
    number = os.fork()
    if number:
        return number
    code = 1
    try:
        said = os.open(folder / f"{work.__name__}.{rank}.txt", os.O_WRONLY | os.O_CREAT)
        os.dup2(said, 2)
        code = process(work, rank, size, port, folder)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)


def main() -> None:
    folder = Path(sys.argv[1])
    training._VALIDATION_BATCH = 5  # so that each process has a part of the validation
    for work, size in RUNS:
        # Where the processes meet: with torchrun, too, a process that outlives them has it.
        store = TCPStore("127.0.0.1", 0, is_master=True, wait_for_workers=False)
        numbers = [fork(work, rank, size, store.port, folder) for rank in range(size)]
        for rank, number in enumerate(numbers):
            code = os.waitstatus_to_exitcode(os.waitpid(number, 0)[1])
            print(work.__name__, rank, code, flush=True)


if __name__ == "__main__":
    main()
