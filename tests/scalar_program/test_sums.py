"""Sums that share factors are made at once, and are the same sums."""

import jax
import jax.numpy as jnp
import numpy as np

from exosight.scalar_program import unroll
from exosight.scalar_program.graph import Graph
from exosight.scalar_program.sums import MOST, Shared, shared_sums


def shared(graph: Graph, apart: tuple[int, ...] = ()) -> dict[int, Shared]:
    own = [i for i in range(len(graph.op)) if graph.op[i] >= 0]
    return shared_sums(graph.op, graph.args, own, dict.fromkeys(own), apart)


def dot(graph: Graph, a: list[int], b: list[int]) -> int:
    return graph.dot(zip(a, b, strict=True))


def test_sums_of_a_product_of_matrices_are_those_made_alone() -> None:
    """To the last bit: the same products in the same order. 7 × 5 sums leave some alone or in twos."""
    a, b = np.random.default_rng(0).normal(size=(2, 7, 5))
    zero = np.zeros(5)
    together = unroll(lambda x: (x[0] @ x[1].T,), [(a, b)])
    alone = unroll(lambda x: (jnp.dot(*x),), [(zero, zero)])
    each = jax.vmap(jax.vmap(lambda x, y: alone(0, None, (x, y))[0], (None, 0)), (0, None))
    np.testing.assert_array_equal(together(0, None, (a, b))[0], each(a, b))


def test_every_sum_of_a_product_is_made_once() -> None:
    graph = Graph()
    a = np.array(graph.inputs(12)).reshape(4, 3).tolist()
    b = np.array(graph.inputs(18)).reshape(6, 3).tolist()
    sums = {dot(graph, x, y): set(zip(x, y, strict=True)) for x in a for y in b}
    found = shared(graph)
    made = [i for group in found.values() for i in group.sums]
    assert sorted(made) == sorted(sums)  # rows of six: two groups of three each, none alone
    for first, group in found.items():
        assert first == group.sums[0]
        assert 1 < len(group.sums) <= MOST
        terms = np.array(group.operands).reshape(3, -1)
        for at, i in enumerate(group.sums, start=1):
            assert {tuple(sorted(pair)) for pair in terms[:, [0, at]].tolist()} == sums[i]


def test_a_sum_of_another_one_is_not_made_with_it() -> None:
    graph = Graph()
    a, b = list(graph.inputs(3)), list(graph.inputs(3))
    first = dot(graph, a, b)
    dot(graph, a, [*b[:2], first])
    assert not shared(graph)


def test_sums_without_a_factor_in_common_are_made_alone() -> None:
    graph = Graph()
    a, b, c, d = (list(graph.inputs(3)) for _ in range(4))
    first, second = dot(graph, a, b), dot(graph, a, d)
    dot(graph, [*a[:2], c[0]], c)  # no factor in common in the last term
    assert [group.sums for group in shared(graph).values()] == [[first, second]]
    assert not shared(graph, apart=(second,))
