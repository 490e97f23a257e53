"""Numbers of a design that a program need not compute with: zeros and ones of its placements, and copies.

A finger in a plane has mounts, offsets and natural strains without a component out of it. In a program whose
robots all have these zeros, whatever they multiply disappears, and what follows from that: half of the
operations of the published exosuit.

Numbers count in groups, so that few different programs are made: each one of a pose, and each component of
the strains of a body or of all vectors of a body or a term.

A term that holds another one, as friction its contact, has a copy of its numbers. Where all are the same, a
program finds what follows from them once.
"""

from collections import defaultdict
from collections.abc import Hashable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from exosight.mechanics.term import Term

Known = bytes
"""Of each group of numbers: ZERO, ONE, or UNKNOWN; then of each pair of terms: ONE if they are the same."""

ZERO, ONE, UNKNOWN = range(3)


class Groups(NamedTuple):
    """Groups of a robot's numbers, that are known together.

    leaves   which of its arrays have numbers in a group
    order    (numbers,)   those of these arrays, one after the other, group by group
    start    (groups,)    where each begins in `order`
    """

    leaves: list[int]
    order: Int[np.ndarray, " numbers"]
    start: Int[np.ndarray, " groups"]


def known_numbers(structure: Hashable, leaves: Sequence[Float[np.ndarray, "robots ..."]]) -> Known:
    """What is zero, one, or a copy, in all robots of a structure, from their arrays."""
    groups = _groups(structure, tuple(leaf.shape[1:] for leaf in leaves))
    same = [
        all(np.array_equal(leaves[i], leaves[j]) for i, j in zip(*pair, strict=True))
        for pair in _copies(structure)
    ]
    copies = np.where(same, ONE, UNKNOWN).astype(np.uint8).tobytes()
    if not groups.leaves:
        return copies
    count = len(leaves[0])
    numbers = np.concatenate([leaves[i].reshape(count, -1) for i in groups.leaves], axis=1)[:, groups.order]
    zero, one = (
        np.logical_and.reduceat(np.all(numbers == value, axis=0), groups.start) for value in (0.0, 1.0)
    )
    return np.where(zero, ZERO, np.where(one, ONE, UNKNOWN)).astype(np.uint8).tobytes() + copies


def with_known(structure: Hashable, known: Known, leaves: Sequence[Any]) -> list[Any]:
    """A robot's arrays with the numbers that are known in their places; nothing known: as they are."""
    leaves = list(leaves)
    if not known:
        return leaves
    groups = _groups(structure, tuple(np.shape(leaf) for leaf in leaves))
    found = np.frombuffer(known, np.uint8)
    sizes = [np.size(leaves[i]) for i in groups.leaves]
    numbers = np.full(sum(sizes), np.nan)
    counts = np.diff(np.append(groups.start, len(groups.order)))
    values = np.array([0.0, 1.0, np.nan])[found[: len(groups.start)]]
    numbers[groups.order] = np.repeat(values, counts)
    for i, own in zip(groups.leaves, np.split(numbers, np.cumsum(sizes))[:-1], strict=True):
        value = own.reshape(np.shape(leaves[i]))
        leaves[i] = jax.numpy.where(np.isnan(value), leaves[i], value)
    for (copy, own), same in zip(_copies(structure), found[len(groups.start) :], strict=True):
        if same == ONE:
            for i, j in zip(copy, own, strict=True):
                leaves[i] = leaves[j]
    return leaves


@lru_cache(maxsize=64)
def _copies(structure: Any) -> list[tuple[list[int], list[int]]]:
    """Numbers of the arrays of a term that another one holds, and of a term of the robot of the same kind."""
    terms = jax.tree.unflatten(structure, range(structure.num_leaves)).terms
    held = [part for term in terms for part in vars(term).values() if isinstance(part, Term)]
    return [
        (jax.tree.leaves(part), jax.tree.leaves(term))
        for part in held
        for term in terms
        if jax.tree.structure(part) == jax.tree.structure(term)
    ]


@lru_cache(maxsize=64)
def _groups(structure: Any, shapes: tuple[tuple[int, ...], ...]) -> Groups:
    robot = jax.tree.unflatten(structure, [np.zeros(shape) for shape in shapes])
    members = defaultdict[Any, list[np.ndarray]](list)
    leaves: list[int] = []
    total = 0
    for i, (path, leaf) in enumerate(jax.tree.leaves_with_path(robot)):
        pose, remembered = leaf.shape[-2:] == (4, 4), path[-1] == jax.tree_util.GetAttrKey("memory")
        if remembered or not (pose or leaf.shape[-1:] in ((3,), (6,))):
            continue
        places = total + np.arange(leaf.size)
        if pose:
            members |= {(path, place): [np.array([place])] for place in places.tolist()}
        else:
            owner = path[:-1] if leaf.shape[-1] == 3 else path
            for k, column in enumerate(places.reshape(-1, leaf.shape[-1]).T):
                members[owner, leaf.shape[-1], k].append(column)
        leaves.append(i)
        total += leaf.size
    together = [np.concatenate(of_group) for of_group in members.values()]
    order = np.concatenate(together) if together else np.zeros(0, int)
    return Groups(leaves, order, np.cumsum([0, *map(len, together)])[:-1])
