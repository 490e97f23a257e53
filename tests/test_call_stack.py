"""A thread has frames of its own, so what a test finds does not depend on how deep the test is called."""

import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

from exosight.call_stack import with_room_for_frames

resource = pytest.importorskip("resource", reason="the operating system does not count page faults")

CALLS = 500

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="page faults of a thread are counted on Linux"
)


def called_many_times(depth: int) -> int:
    """Page faults of a loop of calls that deep."""
    if depth:
        return called_many_times(depth - 1)
    before = resource.getrusage(resource.RUSAGE_THREAD).ru_minflt
    for number in range(CALLS):
        identity(number)
    return resource.getrusage(resource.RUSAGE_THREAD).ru_minflt - before


def identity(number: int) -> int:
    return number


def most(count: Callable[[int], int]) -> int:
    with ThreadPoolExecutor(1) as thread:
        return max(thread.map(count, range(300)))  # a frame takes about 100 bytes: beyond 16 KiB


def test_no_depth_maps_memory_with_every_call() -> None:
    assert most(with_room_for_frames(called_many_times)) < CALLS / 10


@pytest.mark.skipif(sys.version_info >= (3, 13), reason="later releases of Python keep a piece of memory")
def test_without_room_some_depth_does() -> None:
    """Else the test above says nothing."""
    assert most(called_many_times) >= CALLS


def test_results_errors_and_names_are_those_of_the_function() -> None:
    @with_room_for_frames
    def divided(a: int, *, by: int) -> float:
        """A quotient."""
        return a / by

    assert divided(3, by=2) == 1.5
    assert (divided.__name__, divided.__doc__) == ("divided", "A quotient.")
    with pytest.raises(ZeroDivisionError):
        divided(1, by=0)
