"""Tasks on several processes: all of them done, failures told, and no worker left behind."""

import builtins
import os
import signal
from collections.abc import Iterator

import pytest

from exosight.dataset import engine
from exosight.dataset.engine import LOCAL_CLUSTER, on_cluster
from exosight.errors import DataError, InputError

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a running cluster of two processes that gives up a task at its first dead worker."""
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(n_workers=2, silence_logs=50, **LOCAL_CLUSTER) as cluster,
    ):
        yield cluster.scheduler_address


def test_every_task_is_done_once_on_the_workers_of_a_scheduler(scheduler: str) -> None:
    def task(number: int) -> tuple[int, int]:
        import os

        return number, os.getpid()

    found = list(on_cluster(task, range(20), workers=1, scheduler=scheduler))
    assert sorted(number for number, _ in found) == list(range(20))
    assert os.getpid() not in {process for _, process in found}


@pytest.mark.filterwarnings("error")
def test_two_jobs_on_one_machine_do_not_meet() -> None:
    first = on_cluster(abs, [-1, -2], workers=1)
    found = [next(first)]
    assert sorted(on_cluster(abs, [-3, -4], workers=1)) == [3, 4]
    assert sorted([*found, *first]) == [1, 2]


def test_what_a_task_raises_arrives_as_it_is(scheduler: str) -> None:
    def task(number: int) -> int:
        from exosight.errors import DataError

        if number == 3:
            raise DataError("chunk 3: the disk is full")
        return number

    with pytest.raises(DataError, match="chunk 3: the disk is full"):
        list(on_cluster(task, range(5), workers=1, scheduler=scheduler))


def test_a_task_that_kills_its_worker_is_given_up(scheduler: str) -> None:
    def task(number: int) -> None:
        import os

        os.kill(os.getpid(), signal.SIGKILL)

    with pytest.raises(DataError, match="died again and again at the same task"):
        list(on_cluster(task, [0], workers=1, scheduler=scheduler))


def test_a_scheduler_that_is_not_there_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "CONNECT_SECONDS", 0.5)
    for address in ("tcp://127.0.0.1:9", "nonsense://x", "tcp://"):
        with pytest.raises(DataError, match="cannot be reached; expected the address of a running Dask"):
            list(on_cluster(len, [0], workers=1, scheduler=address))


def test_without_the_extra_its_name_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def missing(name: str, *rest: object) -> object:
        if name == "distributed":
            raise ModuleNotFoundError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(InputError, match=r"needs the extra 'cluster'"):
        list(on_cluster(len, [0], workers=2))
