"""Room for the frames of Python functions that call many others.

Until late releases of Python 3.13 and 3.14, frames lie on pieces of memory of 16 KiB, and a piece goes back
to the operating system as soon as the first frame on it returns. Where that is a function called in a loop,
every call maps and unmaps a piece: making the program of `index` took 16 instead of 7 s at some depths of its
caller (https://github.com/python/cpython/issues/142183).
"""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

ROOM = 2**16
"""Words of a frame. Its piece of memory is of the next power of two, so frames that follow have as many."""


def with_room_for_frames(function: Callable[P, R]) -> Callable[P, R]:
    """The same function; the frames of all that it calls lie on one piece of memory."""

    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        return function(*args, **kwargs)

    call.__code__ = call.__code__.replace(co_stacksize=ROOM)
    return wraps(function)(call)
