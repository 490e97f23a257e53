"""One training run on several processes, each with a GPU of its own, as `torchrun` starts them.

Each process walks the same batches and takes its slice of each. Losses and gradients are added up, each slice
with its share of the batch: a step is that of the whole batch, however many processes take it. What differs:

- Rounding, as sums are taken in another order.
- Moves, fading and noise of the images: drawn for each slice from seed, epoch, step and process, as drawing
  those of the whole batch would take each process nearly as long as one alone.
- Batch normalisation: on GPUs of the whole batch; on CPUs, for which PyTorch has no such layer, of the slice,
  and the statistics kept are those of the first process.
"""

import hashlib
import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from datetime import timedelta
from typing import Literal, cast

import torch
import torch.distributed as dist

# Before there is a group: functions in it keep the one that is there at its first import as a default. The
# first optimiser imports it, and the group's threads then outlived the group, into Python's end (an abort).
import torch.distributed.nn
from torch import Tensor, nn
from torch.distributed.distributed_c10d import Store
from torch.distributed.rendezvous import rendezvous

from exosight.errors import DataError, InputError
from exosight.learning.config import Precision
from exosight.learning.networks import Network
from exosight.learning.process_group import SINGLE, ProcessGroup
from exosight.learning.training_data import FrameBlock

_OF_A_BLOCK = (
    (3, torch.uint8),
    (2, torch.float32),
    (2, torch.float32),
    (2, torch.float32),
    (1, torch.int64),
)
"""Dimensions and type of each array of a FrameBlock."""

_PATIENCE = timedelta(minutes=30)
"""For the slowest process; one that ends is noticed at once."""


def choose_device(wanted: Literal["auto", "cpu", "cuda"]) -> Literal["cpu", "cuda"]:
    """What `auto` means on this machine; InputError for a GPU that is not there."""
    if wanted == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    if wanted == "cuda" and not torch.cuda.is_available():
        raise InputError("device: cuda was asked for, but PyTorch finds no GPU; use auto or cpu")
    return wanted


def choose_precision(device: Literal["cpu", "cuda"]) -> Precision:
    """The fastest that the machine has in hardware; bfloat16 halves the time of a step."""
    has = torch.cuda.is_bf16_supported() if device == "cuda" else torch.ops.mkldnn._is_mkldnn_bf16_supported()
    return "bfloat16" if has else "float32"


@contextmanager
def join(wanted: Literal["auto", "cpu", "cuda"]) -> Iterator[ProcessGroup]:
    """The processes that torchrun says are this run's; without torchrun, this process alone.

    If one fails, all end: the first to fail with its error, the others with exit code 2 and no words.

    Raises InputError if they cannot meet, or if this process finds no GPU left for it.
    """
    if int(os.environ.get("WORLD_SIZE") or "1") == 1:
        yield SINGLE
        return
    device = choose_device(wanted)
    local, local_size = (int(os.environ.get(f"LOCAL_{name}", "0")) for name in ("RANK", "WORLD_SIZE"))
    if device == "cuda" and local >= torch.cuda.device_count():
        raise InputError(
            f"torchrun: expected at most one process for each GPU of a machine, {torch.cuda.device_count()} "
            f"here, got {local_size}; lower --nproc-per-node"
        )
    with torch.cuda.device(local) if device == "cuda" else nullcontext():
        backend = "nccl" if device == "cuda" else "gloo"
        try:
            store, rank, size = next(rendezvous("env://"))
            dist.init_process_group(backend, store=store, rank=rank, world_size=size, timeout=_PATIENCE)
        except (ValueError, RuntimeError) as error:
            raise InputError(
                f"WORLD_SIZE is set, but the processes cannot meet ({error}); "
                "start them with torchrun, or unset it"
            ) from error
        try:
            yield ProcessGroup(rank, size, max(local_size, 1), device)
        except BaseException as error:
            speaks = _first_to_fail(store)
            # Closing in good order would wait for processes that may wait for this one.
            if dist.group.WORLD is not None:
                dist.group.WORLD.abort()
            if isinstance(error, Exception) and not speaks:
                time.sleep(1.0)  # torchrun stops the others once one has left: first let the other speak
                raise SystemExit(2) from None
            raise
        finally:
            dist.destroy_process_group()


def synchronised(group: ProcessGroup, network: Network) -> Network:
    """The network, its batch normalisation made that of the whole batch where that is possible."""
    if group.size == 1 or group.device == "cpu":
        return network
    return cast(Network, nn.SyncBatchNorm.convert_sync_batchnorm(network))


def all_reduce_sum(group: ProcessGroup, tensors: Iterable[Tensor]) -> None:
    """Put into each tensor its sum over all processes; the tensors are of one type.

    One message for all gradients: these networks are small, so that sending while the backward pass still
    runs, as DistributedDataParallel does, would gain little.
    """
    _exchange(group, list(tensors), dist.all_reduce)


def broadcast(group: ProcessGroup, tensors: Iterable[Tensor]) -> None:
    """Put into each tensor what the first process has there; the tensors are of one type."""
    _exchange(group, list(tensors), lambda flat: dist.broadcast(flat, 0))


def broadcast_block(group: ProcessGroup, block: FrameBlock | None) -> FrameBlock:
    """The simulated frames that the first process has, in all."""
    if group.size == 1 and block:
        return block
    found = []
    for i, (dimensions, kind) in enumerate(_OF_A_BLOCK):
        shape = torch.tensor(block[i].shape if block else [0] * dimensions)
        broadcast(group, [shape])
        array = torch.from_numpy(block[i]) if block else torch.empty(*shape.tolist(), dtype=kind)
        broadcast(group, [array])
        found.append(array.numpy())
    return FrameBlock(*found)


def check_identical(group: ProcessGroup, what: str, error: str) -> None:
    """Raise InputError in all unless `what` is the same text in all; none goes on before the last."""
    number = int.from_bytes(hashlib.sha256(what.encode()).digest()[:7])
    bounds = torch.tensor([number, -number])
    _exchange(group, [bounds], lambda flat: dist.all_reduce(flat, dist.ReduceOp.MAX))
    if bounds[0] != -bounds[1]:
        raise InputError(error)


def _exchange(group: ProcessGroup, tensors: list[Tensor], send: Callable[[Tensor], object]) -> None:
    if group.size == 1:
        return
    flat = torch.cat([tensor.detach().reshape(-1) for tensor in tensors]).to(group.device)
    try:
        send(flat)
    except RuntimeError as error:
        raise DataError(
            "another process of this run ended before its time (killed, or out of memory?); "
            "run the same command again with --resume"
        ) from error
    with torch.no_grad():
        for tensor, part in zip(tensors, flat.split([tensor.numel() for tensor in tensors]), strict=True):
            tensor.copy_(part.view_as(tensor))


def _first_to_fail(store: Store) -> bool:
    try:
        return store.add("exosight/failed", 1) == 1
    except RuntimeError:
        return True  # what counts them has ended as well
