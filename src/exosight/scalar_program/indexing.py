"""Gathers, scatters and slices: which number of an array goes where, for places that are known beforehand."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jax.lax import GatherScatterMode

from exosight.scalar_program.graph import Graph, Unsupported

Values = np.ndarray
"""An array of numbers of values."""


def known_numbers(graph: Graph, equation: Any, values: Values) -> np.ndarray:
    """Whole numbers that are known beforehand."""
    flat = values.ravel().tolist()
    if not all(value in graph.known for value in flat):
        raise Unsupported(f"{equation.primitive.name} by numbers that depend on the arguments")
    return np.array([graph.known[value] for value in flat], dtype=int).reshape(values.shape)


def _windows(
    shape: Sequence[int],
    sizes: Sequence[int],
    starts: np.ndarray,
    axes: Sequence,
    batched: Sequence[tuple[int, int]],
    clip: bool,
) -> np.ndarray:
    """Flat places in an array of the elements of windows, (*starts, *sizes); −1 in windows that lie outside.

    sizes     of a window along each axis of the array
    starts    (*starts, axes)   first element of each window along `axes`
    batched   pairs (axis of the array, axis of `starts`) that go together
    clip      windows that lie outside are moved in
    """
    count = starts.shape[:-1]
    first = np.zeros((*count, len(shape)), dtype=int)
    first[..., list(axes)] = starts
    for axis, of_starts in batched:
        along = np.arange(count[of_starts])
        first[..., axis] = along.reshape([-1 if i == of_starts else 1 for i in range(len(count))])
    room = np.array(shape, dtype=int) - np.array(sizes, dtype=int)
    inside = np.all((first >= 0) & (first <= room), axis=-1)
    first = np.clip(first, 0, room)
    within = np.moveaxis(np.indices(sizes), 0, -1) if len(shape) else np.zeros((0,), dtype=int)
    places = first.reshape(*count, *[1] * len(sizes), len(shape)) + within
    strides = np.array([int(np.prod(shape[i + 1 :])) for i in range(len(shape))], dtype=int)
    inside = inside.reshape(*count, *[1] * len(sizes)) | clip
    return np.where(inside, places @ strides, -1)


def gather(graph: Graph, equation: Any, x: Values, starts: Values) -> Values:
    """Windows of an array, for the primitive of that name; outside it, the filling."""
    params = equation.params
    numbers, sizes = params["dimension_numbers"], params["slice_sizes"]
    mode = params["mode"]
    if not all(value in graph.known for value in starts.ravel().tolist()):
        return _look_up(graph, equation, x, starts)
    places = _windows(
        x.shape,
        sizes,
        known_numbers(graph, equation, starts),
        numbers.start_index_map,
        list(zip(numbers.operand_batching_dims, numbers.start_indices_batching_dims, strict=True)),
        clip=mode == GatherScatterMode.CLIP,
    )
    kept = [
        size
        for axis, size in enumerate(sizes)
        if axis not in (*numbers.collapsed_slice_dims, *numbers.operand_batching_dims)
    ]
    count = places.shape[: starts.ndim - 1]
    places = np.moveaxis(
        places.reshape(*count, *kept), range(len(count), len(count) + len(kept)), numbers.offset_dims
    )
    filling = params["fill_value"]
    empty = graph.constant(np.nan if filling is None else float(filling))
    return np.where(places < 0, empty, x.ravel()[np.maximum(places, 0)])


def _look_up(graph: Graph, equation: Any, x: Values, starts: Values) -> Values:
    """Rows of an array by numbers that depend on the arguments and are known to lie inside."""
    params = equation.params
    numbers, sizes = params["dimension_numbers"], params["slice_sizes"]
    rows = numbers.start_index_map == (0,) == numbers.collapsed_slice_dims and sizes[1:] == x.shape[1:]
    if not rows or params["mode"] != GatherScatterMode.PROMISE_IN_BOUNDS:
        raise Unsupported("gather by numbers that depend on the arguments, except of rows that lie inside")
    flat = x.reshape(len(x), -1).T.tolist()
    found = [[graph.lookup(row, column) for column in flat] for row in starts.ravel().tolist()]
    count = starts.shape[:-1]
    result = np.array(found, dtype=np.int64).reshape(*count, *x.shape[1:])
    return np.moveaxis(result, range(len(count), result.ndim), numbers.offset_dims)


def scatter(graph: Graph, equation: Any, x: Values, starts: Values, updates: Values) -> Values:
    """An array with windows replaced or added to, for the primitives of that name."""
    params = equation.params
    numbers = params["dimension_numbers"]
    window = numbers.update_window_dims
    single = (*numbers.inserted_window_dims, *numbers.operand_batching_dims)
    sizes = np.ones(x.ndim, dtype=int)
    sizes[[axis for axis in range(x.ndim) if axis not in single]] = [updates.shape[i] for i in window]
    places = _windows(
        x.shape,
        sizes.tolist(),
        known_numbers(graph, equation, starts),
        numbers.scatter_dims_to_operand_dims,
        list(zip(numbers.operand_batching_dims, numbers.scatter_indices_batching_dims, strict=True)),
        clip=params["mode"] == GatherScatterMode.CLIP,
    )
    others = [i for i in range(updates.ndim) if i not in window]
    result = x.flatten()
    for place, value in zip(
        places.ravel().tolist(), updates.transpose(*others, *window).ravel().tolist(), strict=True
    ):
        if place >= 0:
            adds = equation.primitive.name == "scatter-add"
            result[place] = graph.add(int(result[place]), value) if adds else value
    return result


def dynamic_slice(graph: Graph, equation: Any, x: Values, *starts: Values) -> Values:
    """One window, moved inside the array, for the primitive of that name."""
    sizes = equation.params["slice_sizes"]
    room = np.array(x.shape) - sizes
    first = np.clip([known_numbers(graph, equation, start) for start in starts], 0, room)
    return x[tuple(slice(a, a + size) for a, size in zip(first, sizes, strict=True))]
