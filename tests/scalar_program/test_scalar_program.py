"""Unrolled functions give what JAX gives, whatever they are made of."""

from collections.abc import Callable
from random import Random

import hypothesis.extra.numpy as hnp
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exosight.scalar_program import Held, Unsupported, call_unrolled, unroll
from exosight.scalar_program.conditional import arrange
from exosight.scalar_program.graph import Graph
from exosight.scalar_program.operations import DOTS, Op
from exosight.scalar_program.program import Program, Stage, programs
from exosight.scalar_program.tracing import values_of

SAME = 1e-14
"""Some units in the last place: sums are taken in another order, and products fused into them."""

X = np.array([[0.3, -0.7, 0.2], [0.9, 0.0, -0.4], [0.5, 0.25, -0.1]])
POSITIVE = np.abs(X) + 0.1


def run(function: Callable, *arguments: np.ndarray) -> list[np.ndarray]:
    """The leaves of what an unrolled function returns."""
    program = unroll(lambda given: (function(*given),), [arguments])

    def only(*arguments: jax.Array) -> list:
        return jax.tree.leaves(program(0, None, arguments)[0])

    return jax.jit(only)(*arguments)


def rows(x: jax.Array, which: jax.Array) -> jax.Array:
    """Rows whose numbers depend on the arguments."""
    return x.at[which].get(mode="promise_in_bounds")


def check(function: Callable, *arguments: np.ndarray) -> None:
    expected = jax.tree.leaves(function(*map(jnp.asarray, arguments)))
    for ours, theirs in zip(run(function, *arguments), expected, strict=True):
        assert ours.shape == theirs.shape
        np.testing.assert_allclose(ours, theirs.astype(float), rtol=SAME, atol=SAME)


@pytest.mark.parametrize(
    "function",
    [
        *(jnp.sin, jnp.cos, jnp.tan, jnp.arcsin, jnp.arccos, jnp.arctan, jnp.sinh, jnp.cosh, jnp.tanh),
        *(jnp.exp, jnp.expm1, jnp.abs, jnp.negative, jnp.sign, jnp.square, jnp.linalg.norm, jnp.cumsum),
        *(jnp.transpose, jnp.ravel, jnp.flip, jnp.diag, jnp.trace, jnp.sum, jnp.max, jnp.min, jnp.prod),
        *(jnp.isnan, jnp.isfinite),
        lambda x: [(10 * x).astype(int), x.astype(bool)],
    ],
)
def test_functions_of_one_array(function: Callable) -> None:
    check(function, X)


@pytest.mark.parametrize("function", [jnp.sqrt, jnp.log, jnp.log1p, jax.lax.rsqrt, jnp.reciprocal, jnp.cbrt])
def test_functions_of_positive_numbers(function: Callable) -> None:
    check(function, POSITIVE)


@pytest.mark.parametrize(
    "function",
    [
        *(jnp.add, jnp.subtract, jnp.multiply, jnp.divide, jnp.maximum, jnp.minimum, jnp.matmul, jnp.cross),
        *(jnp.arctan2, jnp.power, jnp.dot, jnp.outer, jnp.less, jnp.greater_equal, jnp.equal, jnp.hypot),
        lambda a, b: jnp.where((a < b) & ~(a > 0.4) | (b != a), a, b),
        lambda a, b: jnp.einsum("ij,kj->ik", a, b) @ jnp.stack([a[0], b[1], a[2]]),
        lambda a, b: jnp.concatenate([a, b])[jnp.array([4, 0, 5])],
        lambda a, b: jax.vmap(lambda row, i: row[i])(a, jnp.array([2, 0, 1])) + b[0],
        lambda a, b: jnp.zeros((4, 3)).at[jnp.array([0, 2, 2])].add(a * b),
        lambda a, b: a.at[1, 1:].set(b[0, :2]).at[5].add(1.0, mode="drop"),
        lambda a, b: a.at[jnp.array([0, 7])].get(mode="fill", fill_value=2.5) + b[:2],
        lambda a, b: jnp.pad(a, ((1, 0), (0, 2)), constant_values=3.0)[:, :3] * jnp.pad(b, ((1, 0), (0, 0))),
        lambda a, b: jax.lax.pad(a, 0.0, ((1, -1, 1), (0, 0, 0))).sum() + jnp.clip(b, -0.2, 0.3),
        lambda a, b: jnp.linalg.cholesky(a @ a.T + jnp.eye(3)) @ b,
        lambda a, b: jax.scipy.linalg.cho_solve((jnp.linalg.cholesky(a @ a.T + jnp.eye(3)), True), b),
        lambda a, b: jax.scipy.linalg.solve_triangular(jnp.triu(a) + 2 * jnp.eye(3), b),
        lambda a, b: jax.scipy.linalg.solve_triangular(jnp.tril(a) + 2 * jnp.eye(3), b, lower=True, trans=1),
        lambda a, b: jnp.isfinite(jnp.linalg.cholesky(a @ a.T - jnp.eye(3))[-1, -1]),
        lambda a, b: jax.lax.scan(lambda c, row: (c * row + b[0], c.sum()), a[0], b),
        lambda a, b: jax.lax.scan(lambda c, row: (c + row, c), a[0], b, reverse=True),
        lambda a, b: jax.lax.dynamic_slice(a, (5, 1), (2, 2)) - b[:2, :2],
        lambda a, b: jax.hessian(lambda x: jnp.sum(jnp.sin(x) ** 3 * jnp.exp(b)))(a),
        lambda a, b: jax.grad(lambda x: jnp.linalg.norm(jnp.where(x > 0, x * b, x**-2)))(a + 2.0),
        lambda a, b: [*jnp.split(a, [1]), b],
        lambda a, b: {"pair": (a, b.T), "none": jnp.zeros((0, 2)), "number": 3.0 * a[0, 0]},
        lambda a, b: jnp.sum(jnp.outer(a, b)) + jnp.any(a > 0.8) * jnp.all(b > 0.0),
        lambda a, b: [jnp.argmax(a, axis=0), jnp.argmin(b, axis=1)],
        lambda a, b: rows(b, jnp.argmin(a, axis=1)) @ rows(a[:, 0], jnp.argmax(b, axis=1)),
        lambda a, b: rows(jnp.stack([a, b, a]), jnp.argmax(a @ b, axis=1)),
        lambda a, b: rows(b, jnp.clip(3 * jnp.abs(a[0]), 0, 2).astype(int)),
    ],
)
def test_functions_of_two_arrays(function: Callable) -> None:
    check(function, X, POSITIVE)


NUMBERS = st.floats(-3, 3).filter(lambda x: x == 0 or abs(x) > 1e-6)


@given(hnp.arrays(float, (4,), elements=NUMBERS), st.data())
@settings(max_examples=40)
def test_random_functions(x: np.ndarray, data: st.DataObject) -> None:
    """Random chains of operations on a growing list of arrays."""
    two = {"add": jnp.add, "sub": jnp.subtract, "mul": jnp.multiply, "max": jnp.maximum, "hypot": jnp.hypot}
    one = {"sin": jnp.sin, "neg": jnp.negative, "flip": jnp.flip, "sum": lambda v: jnp.full(4, v.sum())}
    names = data.draw(st.lists(st.sampled_from([*two, *one]), min_size=1, max_size=12))
    picks = [(data.draw(st.integers(0, i)), data.draw(st.integers(0, i))) for i in range(len(names))]
    fixed = data.draw(st.sampled_from([0.0, 1.0, -1.0, 0.5]))

    def function(x: jax.Array) -> jax.Array:
        values = [x]
        for name, (i, j) in zip(names, picks, strict=True):
            a, b = values[i], values[j] * fixed if j % 2 else values[j]
            values.append(jnp.tanh(two[name](a, b) if name in two else one[name](a)))
        return jnp.stack(values)

    check(function, x)


@pytest.mark.parametrize("count", [1, 3, 8, 11])
def test_any_number_of_samples(count: int) -> None:
    """Also some that share an argument, and samples of samples."""
    rng = np.random.default_rng(count)
    a, b = rng.normal(size=(count, 2, 3, 3)), rng.normal(size=(3, 3))
    program = unroll(lambda b, a: ((), jnp.sin(a) @ b), [b, a[0, 0]])

    def staged(a: jax.Array) -> jax.Array:
        return program(1, program(0, None, b)[1], a)[0]

    found = jax.jit(jax.vmap(jax.vmap(staged)))(a)
    np.testing.assert_allclose(found, np.sin(a) @ b, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("count", [1, 3, 8, 11])
def test_what_is_held_is_a_row_of_numbers_again(count: int) -> None:
    """Of any number of samples, of one for all, and of none."""
    rows = np.random.default_rng(count).normal(size=(count, 5))
    program = unroll(lambda a, b: ((), a + b), [rows[0], rows[0]])

    def twice(row: jax.Array) -> jax.Array:
        return Held.of(row).row

    def together(a: jax.Array, b: jax.Array) -> jax.Array:
        return program(1, Held.of(a), b)[0]

    np.testing.assert_array_equal(jax.vmap(twice)(rows), rows)
    np.testing.assert_array_equal(jax.vmap(twice)(rows[:, :0]), rows[:, :0])
    np.testing.assert_array_equal(jax.vmap(together)(rows, rows[::-1]), rows + rows[::-1])
    np.testing.assert_array_equal(jax.vmap(together, (None, 0))(rows[0], rows), rows[0] + rows)


def test_what_the_first_arguments_decide_is_computed_once() -> None:
    """A later stage holds no operation that the arguments before it alone decide."""
    a, b = np.full((6, 6), 0.3), np.full(6, 0.2)
    staged = unroll(lambda a, b: ((), jnp.sin(a @ a @ a) @ b), [a, b])
    together = unroll(lambda ab: (jnp.sin(ab[0] @ ab[0] @ ab[0]) @ ab[1],), [(a, b)])
    assert len(staged.stages[1].code) < 0.2 * len(together.stages[0].code)
    assert len(staged.stages[0].handing) == 36  # the matrix is all that is handed on


@pytest.mark.parametrize("divisor", [3, 49])  # 49 times the nearest number to 1/49 is less than 1
def test_truth_values_and_whole_numbers_keep_their_kinds(divisor: int) -> None:
    def function(x: jax.Array, count: jax.Array, flag: jax.Array) -> tuple[jax.Array, ...]:
        return jnp.where(flag, x, -x), count % divisor, ~flag & (x > 0)

    for count, flag in [(divisor, True), (-divisor, False), (5 * divisor + 2, True), (-1, False)]:
        given = jnp.array([0.5, -0.5]), jnp.array(count), jnp.array(flag)
        for found, expected in zip(call_unrolled(function, *given), function(*given), strict=True):
            assert found.dtype == expected.dtype
            np.testing.assert_array_equal(found, expected)


def test_more_values_than_short_numbers_can_count() -> None:
    x = np.random.default_rng(0).normal(size=70_000)
    np.testing.assert_allclose(
        run(lambda x: jnp.sum(x[::-1] * x[:, None][:, 0]), x)[0], x @ x[::-1], rtol=1e-12
    )


def test_what_is_not_a_number_stays_so() -> None:
    found = run(lambda x: [x.sum(), jnp.maximum(x, 0.0), jnp.sqrt(x)], np.array([np.nan, 1.0, -1.0]))
    np.testing.assert_array_equal(np.isnan(found[0]), True)
    np.testing.assert_array_equal(np.isnan(found[1]), [True, False, False])
    np.testing.assert_array_equal(np.isnan(found[2]), [True, False, True])


@pytest.mark.parametrize(
    ("function", "named"),
    [
        (lambda x: jax.lax.while_loop(lambda v: v.sum() < 3, lambda v: 2 * v, x), "while"),
        (lambda x: jnp.sort(x), "sort"),
        (lambda x: jnp.linalg.cholesky(jnp.stack([jnp.diag(x)] * 2)), "several matrices"),
        (lambda x: jax.scipy.linalg.solve_triangular(jnp.diag(x), x, unit_diagonal=True), "other kinds"),
        (lambda x: x[jnp.argmax(x)], "dynamic_slice"),
        (lambda x: jax.lax.cond(x[0] > 0, jnp.sin, jnp.cos, x), "cond"),
    ],
)
def test_what_cannot_be_unrolled_is_named(function: Callable, named: str) -> None:
    with pytest.raises(Unsupported, match=named):
        unroll(lambda x: (function(x),), [np.ones(3)])


def test_a_stage_cannot_know_what_comes_later() -> None:
    with pytest.raises(ValueError, match="stage 0 depend on arguments of a later one"):
        unroll(lambda a, b: (a + b, ()), [np.ones(2), np.ones(2)])


def touching(x: jax.Array, weights: jax.Array) -> tuple:
    """Sums over points of what counts only where a point touches, as of a contact."""
    gap = x[:, 0]
    touches, deep = gap < 0, gap < -0.5
    force = jnp.exp(-x) * jnp.sin(x @ weights)
    inner = jnp.where(deep[:, None], jnp.sqrt(1 + force**2) @ weights, force)
    block = jnp.where(touches[:, None, None], inner[:, :, None] * force[:, None, :], 0.0)
    which = jnp.where(touches[:, None] & (x > 0.2), 1.0, 0.0)
    total = jnp.sum(block, axis=0) + weights
    rest = which.T @ jnp.where(touches[:, None], force, 0.0)
    return total, rest, weights - block[0], jnp.sum(jnp.where(touches, force @ gap[:3], 0.0))


@given(hnp.arrays(float, (11, 4, 3), elements=st.floats(-1, 1)), st.sampled_from([-2.0, -0.5, 0.5, 2.0]))
@settings(max_examples=20, deadline=None)
def test_what_is_skipped_counts_for_nothing(x: np.ndarray, shift: float) -> None:
    """Whether points touch in all of the samples, in some or in none."""
    weights = np.arange(9.0).reshape(3, 3) / 5
    x = x + shift * (np.arange(4) % 2)[:, None]
    program = unroll(lambda given: (touching(*given),), [(x[0], weights)])
    found = jax.vmap(lambda x: program(0, None, (x, weights))[0])(x)
    for ours, theirs in zip(found, jax.vmap(lambda x: touching(x, weights))(x), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=10 * SAME, atol=10 * SAME)


def reaching(x: jax.Array, step: jax.Array) -> tuple:
    """As a contact that is searched only where things are near: now, and what a step from there needs."""
    near = x[:, 0] > 0
    depth = jnp.where(near, jnp.log(x[:, 0]) + jnp.sum(jnp.exp(jnp.sin(x)), axis=1), -10.0)
    force = jnp.cos(x) * depth[:, None]
    now = jnp.sum(jnp.where((depth > 0)[:, None], force @ force.T @ x, 0.0), axis=0)
    ahead = jnp.where(near, jnp.sum(step * force, axis=1) + depth, 0.0)
    slope = jnp.where((depth > 2) & near, jnp.exp(ahead) * jnp.sum(jnp.sqrt(1 + force**2), axis=1), 0.0)
    return (), now, (jnp.sum(slope * step[:, 0]), jnp.max(ahead))


@given(st.lists(st.sampled_from([-1.0, 0.3, 2.0]), min_size=16, max_size=16), st.randoms())
@settings(max_examples=20, deadline=None)
def test_what_a_later_stage_is_handed_may_have_been_skipped(shifts: list[float], random: Random) -> None:
    """Samples go on to the next stage in another order, so that beside one that needs a value there is
    another one for which it was skipped; and memory begins with what is not a number."""
    rng = np.random.default_rng(0)
    x, steps = rng.uniform(-0.2, 0.2, (16, 6, 3)), rng.normal(size=(16, 6, 3))
    x[..., 0] += np.array(shifts)[:, None]
    program = unroll(lambda _, x, step: reaching(x, step), [np.zeros(1), x[0], steps[0]])

    def pose(x: jax.Array) -> tuple:
        now, held = program(1, program(0, None, jnp.zeros(1))[1], x)
        return now, held.row

    jax.vmap(pose)(np.full_like(x, np.nan))
    now, handed = jax.vmap(pose)(x)
    order = np.array(random.sample(range(16), 16))
    ahead, _ = jax.vmap(lambda handed, step: program(2, Held.of(handed), step))(handed[order], steps[order])
    _, expected, after = jax.vmap(reaching)(x, steps)
    np.testing.assert_allclose(now, expected, rtol=1e-12, atol=1e-12)
    for ours, theirs in zip(ahead, after, strict=True):
        np.testing.assert_allclose(ours, theirs[order], rtol=1e-12, atol=1e-12)


def test_a_stage_skips_what_later_ones_need_under_a_condition_that_it_knows() -> None:
    """The logarithms of what is not near are left out, though a later stage is handed them."""
    graph = Graph()
    x, step = (np.array(graph.inputs(160)).reshape(20, 8) for _ in range(2))
    jaxpr = jax.make_jaxpr(reaching)(np.zeros((20, 8)), np.zeros((20, 8)))
    now, *after = values_of(graph, jaxpr, [x, step])
    stages = [Stage(x.ravel().tolist(), now.ravel().tolist())]
    later = [value for result in after for value in result.ravel().tolist()]
    first, _ = programs(graph, [*stages, Stage(step.ravel().tolist(), later)])
    skips, outside = _outside_blocks(first)
    assert skips >= 20
    assert outside.isdisjoint({Op.LOG, Op.EXP})


def _outside_blocks(program: Program) -> tuple[int, set[int]]:
    """How many blocks a program may skip, and the operations that it never does."""
    code, at, skips, outside = program.code.tolist(), 0, 0, set()
    operands = {Op.SELECT: 3, Op.MULTIPLY_ADD: 3, Op.NEGATIVE_MULTIPLY_ADD: 3, Op.DIFFERENCE: 4}
    single = {Op.NEG, Op.NOT, Op.ABS, Op.SQRT, Op.SIN, Op.COS, Op.EXP, Op.LOG}
    while at < len(code):
        op, count = code[at], code[at + 1]
        at += 2
        if op == Op.SKIP:
            at += 2 + count + code[at] * 2**16
            skips += 1
            continue
        outside.add(op)
        if op in DOTS:
            at += 1 + count * (DOTS[op] + code[at] * (1 + DOTS[op]))
        else:
            at += count * (1 + operands.get(op, 1 if op in single else 2))
    return skips, outside


def test_a_long_chain_of_sums_is_not_one_operation() -> None:
    """How many products one operation has must fit in 16 bits of its code."""
    graph = Graph()
    x, y = graph.inputs(300), graph.inputs(300)
    total = graph.mul(x[0], y[0])
    for k in range(1, 70_000):
        total = graph.add(total, graph.mul(x[k // 300], y[k % 300]))
    (made,) = programs(graph, [Stage([*x, *y], [total])])
    assert made.code.dtype == np.uint16


def test_what_only_a_condition_needs_is_behind_it() -> None:
    """All in an order in which it can be computed; what nobody else needs in blocks of its condition."""
    graph = Graph()
    inputs = np.array(graph.inputs(21), dtype=np.int64)
    jaxpr = jax.make_jaxpr(touching)(np.zeros((4, 3)), np.zeros((3, 3)))
    results = values_of(graph, jaxpr, [inputs[:12].reshape(4, 3), inputs[12:].reshape(3, 3)])
    wanted = {value for result in results for value in result.ravel().tolist()}
    one = graph.constant(1.0)
    op, args = list(graph.op), list(graph.args)
    own = [i for i in range(len(op)) if op[i] >= 0]
    blocks, instead, _, _ = arrange(op, args, graph.known, own, dict.fromkeys(wanted, ()), one)
    known = set(range(len(op))) - set(own) - {i for block in blocks for i in block.values}
    for block in blocks:
        assert block.condition is None or block.condition in known
        for i in block.values:
            assert known.issuperset(args[i])
            known.add(i)
    assert known >= wanted
    sines = {i for i in own if op[i] == Op.SIN}
    guarded = {i for block in blocks if block.condition is not None for i in block.values}
    assert len(sines) == 12
    assert guarded.issuperset(sines)
    assert instead
    assert guarded.issuperset(instead)
