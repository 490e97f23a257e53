"""Tasks on several processes or machines, by Dask: it hands the tasks of a lost worker to another.

Needs the extra `cluster`. How to run on SLURM: docs/cluster.md.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from exosight.errors import DataError, InputError

Result = TypeVar("Result")

CONNECT_SECONDS = 10
"""How long a scheduler may take to answer."""

LOCAL_CLUSTER = {
    "threads_per_worker": 1,
    "dashboard_address": None,
    # Dask serves its state even so: at its usual port two jobs on a machine would meet.
    "scheduler_kwargs": {"dashboard_address": "127.0.0.1:0"},
}
"""Options of every cluster of processes on one machine."""


def on_cluster(
    task: Callable[[int], Result], numbers: Sequence[int], workers: int, scheduler: str | None = None
) -> Iterator[Result]:
    """The results of task(number), in the order in which they are done.

    task        a function that other processes can import, with arguments that can be sent to them
    workers     processes to start on this machine
    scheduler   address of a running Dask scheduler, whose workers are used instead

    An exception of a task ends all. A worker that dies is replaced and its tasks run again, so a task must
    do no harm when it runs twice.

    Raises InputError without the extra, DataError if the scheduler cannot be reached or a task kills its
    worker again and again.
    """
    try:
        import distributed
    except ImportError as error:
        raise InputError(
            "workers: more than one process needs the extra 'cluster'; pip install 'exosight[cluster]', or "
            "leave --workers and --scheduler out"
        ) from error
    with _client(distributed, workers, scheduler) as client:
        futures = client.map(task, numbers, pure=False)
        try:
            for _, result in distributed.as_completed(futures, with_results=True):
                yield result
        except distributed.KilledWorker as error:
            raise DataError(
                f"worker: died again and again at the same task ({error.task}); give it more memory"
            ) from error
        except distributed.CancelledError as error:
            raise DataError("scheduler: lost while tasks were under way; start it and resume") from error


@contextmanager
def _client(distributed: Any, workers: int, scheduler: str | None) -> Iterator[Any]:
    if scheduler is None:
        # Without a limit of memory: Dask's default would stop a worker that needs more than an equal share.
        with (
            distributed.LocalCluster(n_workers=workers, memory_limit=None, **LOCAL_CLUSTER) as cluster,
            distributed.Client(cluster) as client,
        ):
            yield client
        return
    try:
        client = distributed.Client(scheduler, timeout=CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        raise DataError(
            f"scheduler {scheduler}: cannot be reached; expected the address of a running Dask scheduler, "
            "like tcp://node:8786"
        ) from error
    with client:
        yield client
