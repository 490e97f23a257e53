"""Loops over pixels, compiled to machine code."""

from collections.abc import Callable

from numba import njit


def compiled(function: Callable) -> Callable:
    """Compile to machine code, kept on disk where some folder can be written, else in memory only.

    Without fast-math, so that pictures do not depend on the processor that compiled them.
    """
    try:
        return njit(cache=True, nogil=True)(function)
    except RuntimeError:  # neither the package's folder nor the user's cache folder can be written
        return njit(nogil=True)(function)


def inlined(function: Callable) -> Callable:
    """Compile as a part of the functions that call it, for what is so short that the call itself counts."""
    return njit(inline="always")(function)
