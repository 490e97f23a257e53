"""A JAX function as a graph of operations on single numbers: its jaxpr, unrolled.

Arrays become arrays of value numbers, so moving data costs nothing in the program: a transposition, a slice
or a gather only changes which value stands where.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, no_type_check

import numpy as np
from jax.extend.core import ClosedJaxpr, Literal

from exosight.scalar_program.graph import Graph, Unsupported
from exosight.scalar_program.indexing import Values, dynamic_slice, gather, known_numbers, scatter
from exosight.scalar_program.operations import Op


def values_of(graph: Graph, closed: ClosedJaxpr, inputs: Sequence[Values]) -> list[Values]:
    """The values of the results of a jaxpr; Unsupported for what cannot be unrolled."""
    return _run(graph, closed.jaxpr, [_lift(graph, c) for c in closed.consts], inputs)


@no_type_check  # see conditional
def _lift(graph: Graph, value: Any) -> Values:
    value = np.asarray(value)
    if value.dtype.kind not in "fiub":
        raise Unsupported(f"numbers of type {value.dtype}")
    different, which = np.unique(value.astype(float), return_inverse=True)
    numbers = np.array([graph.constant(v) for v in different.tolist()], dtype=np.int64)
    return np.asarray(numbers[which]).reshape(value.shape)


@no_type_check  # see conditional
def _run(graph: Graph, jaxpr: Any, consts: Sequence[Values], inputs: Sequence[Values]) -> list[Values]:
    values: dict[Any, Values] = {}

    def read(name: Any) -> Values:
        return _lift(graph, name.val) if isinstance(name, Literal) else values[name]

    values.update(zip(jaxpr.constvars, consts, strict=True))
    values.update(zip(jaxpr.invars, inputs, strict=True))
    for equation in jaxpr.eqns:
        name = equation.primitive.name
        rule = RULES.get(name)
        if rule is None:
            raise Unsupported(f"primitive {name}")
        arguments = [read(v) for v in equation.invars]
        results = rule(graph, equation, *arguments)
        results = results if isinstance(results, list) else [results]
        for var, result in zip(equation.outvars, results, strict=True):
            values[var] = np.asarray(result, dtype=np.int64).reshape(var.aval.shape)
    return [read(v) for v in jaxpr.outvars]


@no_type_check  # see conditional
def _each(function: Callable, *arrays: Any) -> Values:
    """A scalar function on arrays of value numbers, broadcast."""
    return np.asarray(np.frompyfunc(function, len(arrays), 1)(*arrays), dtype=np.int64)


def _operation(op: Op) -> Callable:
    return lambda graph, equation, *x: _each(lambda *args: graph.apply(op, *args), *x)


def _logical(op: Op) -> Callable:
    def rule(graph: Graph, equation: Any, *x: Values) -> Values:
        if equation.outvars[0].aval.dtype != np.dtype(bool):
            raise Unsupported(f"{equation.primitive.name} of the bits of whole numbers")
        return _each(lambda *args: graph.apply(op, *args), *x)

    return rule


def _method(name: str) -> Callable:
    return lambda graph, equation, *x: _each(getattr(graph, name), *x)


def _quotient(graph: Graph, equation: Any, a: Values, b: Values) -> Values:
    if equation.outvars[0].aval.dtype.kind != "f":
        raise Unsupported("division of whole numbers")
    return _each(graph.div, a, b)


def _call(graph: Graph, equation: Any, *x: Values) -> list[Values]:
    inner = equation.params.get("jaxpr", equation.params.get("call_jaxpr"))
    return values_of(graph, inner, x) if isinstance(inner, ClosedJaxpr) else _run(graph, inner, [], x)


def _platform(graph: Graph, equation: Any) -> Values:
    """Which of the functions for several platforms is that for CPUs, or for all others (None)."""
    platforms = equation.params["platforms"]
    for_cpu = [i for i, names in enumerate(platforms) if names is None or "cpu" in names]
    return _lift(graph, np.array(for_cpu[0]))


def _branch(graph: Graph, equation: Any, which: Values, *x: Values) -> list[Values]:
    """One of several functions, if it is known which."""
    branches = equation.params["branches"]
    at = int(np.clip(known_numbers(graph, equation, which), 0, len(branches) - 1))
    return values_of(graph, branches[at], x)


def _scan(graph: Graph, equation: Any, *x: Values) -> list[Values]:
    params = equation.params
    fixed, carried, length = params["num_consts"], params["num_carry"], params["length"]
    state, steps = list(x[fixed : fixed + carried]), []
    order = range(length)
    for i in reversed(order) if params["reverse"] else order:
        given = [*x[:fixed], *state, *(rows[i] for rows in x[fixed + carried :])]
        result = values_of(graph, params["jaxpr"], given)
        state = result[:carried]
        steps.append(result[carried:])
    if params["reverse"]:
        steps.reverse()
    return [*state, *(np.stack(rows) for rows in zip(*steps, strict=True))]


def _remainder(graph: Graph, equation: Any, a: Values, b: Values) -> Values:
    """a − b trunc(a/b), of the sign of a; truly divided, as 49 times the nearest to 1/49 is less than 1."""

    def remainder(x: int, y: int) -> int:
        return graph.sub(x, graph.mul(y, graph.apply(Op.TRUNC, graph.apply(Op.DIV, x, y))))

    return _each(remainder, a, b)


def _power(graph: Graph, equation: Any, x: Values) -> Values:
    exponent = equation.params["y"]
    result = _lift(graph, np.ones(x.shape))
    for _ in range(abs(exponent)):
        result = _each(graph.mul, result, x)
    if exponent < 0:
        result = _each(graph.div, _lift(graph, np.ones(x.shape)), result)
    return result


def _inverse_root(graph: Graph, equation: Any, x: Values) -> Values:
    return _each(lambda a: graph.div(graph.constant(1.0), graph.apply(Op.SQRT, a)), x)


def _sign(graph: Graph, equation: Any, x: Values) -> Values:
    def sign(a: int) -> int:
        zero = graph.constant(0.0)
        return graph.sub(graph.apply(Op.GT, a, zero), graph.apply(Op.LT, a, zero))

    return _each(sign, x)


def _finite(graph: Graph, equation: Any, x: Values) -> Values:
    infinity = graph.constant(np.inf)
    return _each(lambda a: graph.apply(Op.LT, graph.apply(Op.ABS, a), infinity), x)


def _select(graph: Graph, equation: Any, which: Values, *cases: Values) -> Values:
    if len(cases) != 2:
        raise Unsupported("select of more than two cases")
    return _each(graph.select, which, cases[1], cases[0])


def _clamp(graph: Graph, equation: Any, low: Values, x: Values, high: Values) -> Values:
    raised = _each(lambda a, b: graph.apply(Op.MAX, a, b), x, low)
    return _each(lambda a, b: graph.apply(Op.MIN, a, b), raised, high)


def _convert(graph: Graph, equation: Any, x: Values) -> Values:
    before, after = equation.invars[0].aval.dtype, equation.outvars[0].aval.dtype
    if before.kind == "f" and after.kind in "iu":
        return _each(lambda a: graph.apply(Op.TRUNC, a), x)
    if before.kind == "f" and after.kind == "b":
        return _each(lambda a: graph.apply(Op.NE, a, graph.constant(0.0)), x)
    return x


def _iota(graph: Graph, equation: Any) -> Values:
    params = equation.params
    axis = params["dimension"]
    shape = params["shape"]
    along = np.arange(shape[axis]).reshape([-1 if i == axis else 1 for i in range(len(shape))])
    return _lift(graph, np.broadcast_to(along, shape))


def _broadcast(graph: Graph, equation: Any, x: Values) -> Values:
    shape = [1] * len(equation.params["shape"])
    for size, axis in zip(x.shape, equation.params["broadcast_dimensions"], strict=True):
        shape[axis] = size
    return np.broadcast_to(x.reshape(shape), equation.params["shape"])


def _slice(graph: Graph, equation: Any, x: Values) -> Values:
    params = equation.params
    steps = params["strides"] or [1] * x.ndim
    bounds = zip(params["start_indices"], params["limit_indices"], steps, strict=True)
    return x[tuple(slice(*bound) for bound in bounds)]


def _pad(graph: Graph, equation: Any, x: Values, filling: Values) -> Values:
    shape = equation.outvars[0].aval.shape
    result = np.full(shape, filling.item(), dtype=np.int64)
    into, source = [], []
    for size, old, (low, _, gap) in zip(shape, x.shape, equation.params["padding_config"], strict=True):
        place = low + np.arange(old) * (gap + 1)
        inside = (place >= 0) & (place < size)
        into.append(place[inside])
        source.append(np.flatnonzero(inside))
    result[np.ix_(*into)] = x[np.ix_(*source)]
    return result


def _reduced(equation: Any, x: Values) -> Values:
    """The values to be reduced, (results, each)."""
    axes = equation.params["axes"]
    kept = [i for i in range(x.ndim) if i not in axes]
    sizes = (int(np.prod([x.shape[i] for i in some])) for some in (kept, axes))
    return x.transpose(*kept, *axes).reshape(*sizes)


def _sum(graph: Graph, equation: Any, x: Values) -> list[Values]:
    one = graph.constant(1.0)
    rows = _reduced(equation, x).tolist()
    op, args = graph.op, graph.args

    def term(value: int) -> tuple[int, int]:
        """Two factors; the sign of a product goes to the first one, which several products may share."""
        if op[value] == Op.NEG and op[args[value][0]] == Op.MUL:
            x, y = args[args[value][0]]
            return graph.neg(x), y
        return value, one

    return [np.array([graph.dot(term(value) for value in row) for row in rows], dtype=np.int64)]


def _reduce(op: Callable) -> Callable:
    def rule(graph: Graph, equation: Any, x: Values) -> list[Values]:
        results = []
        for first, *rest in _reduced(equation, x).tolist():
            for value in rest:
                first = op(graph, first, value)
            results.append(first)
        return [np.array(results, dtype=np.int64)]

    return rule


def _place(op: Op) -> Callable:
    """Where along an axis the first of the largest (GT) or smallest (LT) numbers stands."""

    def rule(graph: Graph, equation: Any, x: Values) -> list[Values]:
        places = []
        for best, *rest in _reduced(equation, x).tolist():
            place = graph.constant(0.0)
            for i, value in enumerate(rest):
                better = graph.apply(op, value, best)
                best = graph.select(better, value, best)
                place = graph.select(better, graph.constant(i + 1.0), place)
            places.append(place)
        return [np.array(places, dtype=np.int64)]

    return rule


def _running_sum(graph: Graph, equation: Any, x: Values) -> Values:
    axis, backwards = equation.params["axis"], equation.params["reverse"]
    rows = np.moveaxis(x, axis, 0)
    rows = rows[::-1] if backwards else rows
    sums = [rows[0]]
    for row in rows[1:]:
        sums.append(_each(graph.add, sums[-1], row))
    whole = np.stack([np.asarray(row, dtype=np.int64) for row in sums])
    return np.moveaxis(whole[::-1] if backwards else whole, 0, axis)


def _product(graph: Graph, equation: Any, a: Values, b: Values) -> list[Values]:
    (left, right), (left_batch, right_batch) = equation.params["dimension_numbers"]
    shape = equation.outvars[0].aval.shape
    if 0 in shape or a.size == 0:
        return [_lift(graph, np.zeros(shape))]
    left_free = [i for i in range(a.ndim) if i not in (*left, *left_batch)]
    right_free = [i for i in range(b.ndim) if i not in (*right, *right_batch)]
    batch = int(np.prod([a.shape[i] for i in left_batch]))
    inner = int(np.prod([a.shape[i] for i in left]))
    rows = a.transpose(*left_batch, *left_free, *left).reshape(batch, -1, inner)
    columns = b.transpose(*right_batch, *right_free, *right).reshape(batch, -1, inner)
    return [np.concatenate([_dots(graph, *pair) for pair in zip(rows, columns, strict=True)])]


@no_type_check  # see conditional
def _dots(graph: Graph, rows: Values, columns: Values) -> Values:
    """The product of each row with each column; of most of their products a factor is known to be zero."""
    zeros = graph.zeros()
    inside, within = ~np.isin(rows, zeros), ~np.isin(columns, zeros)
    results = []
    for row, of_row in zip(rows, inside, strict=True):
        which, place = np.nonzero(of_row & within)
        pairs = list(zip(row[place].tolist(), columns[which, place].tolist(), strict=True))
        ends = np.cumsum(np.bincount(which, minlength=len(columns))).tolist()
        results += [graph.dot(pairs[start:end]) for start, end in pairwise([0, *ends])]
    return np.array(results, dtype=np.int64)


def _cholesky(graph: Graph, equation: Any, x: Values) -> Values:
    """L of L Lᵀ; without a positive pivot, its diagonal is not a number from there on."""
    if x.ndim != 2:
        raise Unsupported("factorisation of several matrices")
    one, zero = graph.constant(1.0), graph.constant(0.0)
    rows: list[list[int]] = []
    inverse: list[int] = []
    for i, given in enumerate(x.tolist()):
        row: list[int] = []
        for j, above in enumerate(rows):
            rest = graph.sub(given[j], graph.dot(zip(row, above, strict=False)))
            row.append(graph.mul(rest, inverse[j]))
        pivot = graph.sub(given[i], graph.dot(zip(row, row, strict=True)))
        row.append(graph.apply(Op.SQRT, pivot))
        inverse.append(graph.div(one, row[i]))
        rows.append(row)
    return np.array([row + [zero] * (len(rows) - len(row)) for row in rows], dtype=np.int64)


def _triangular_solve(graph: Graph, equation: Any, a: Values, b: Values) -> Values:
    """X of a X = b, or with aᵀ in the place of a."""
    params = equation.params
    if a.ndim != 2 or not params["left_side"] or params["unit_diagonal"]:
        raise Unsupported("triangular systems of other kinds than a X = b")
    rows = (a.T if params["transpose_a"] else a).tolist()
    forwards = params["lower"] != params["transpose_a"]
    order = range(len(rows)) if forwards else range(len(rows) - 1, -1, -1)
    one = graph.constant(1.0)
    columns = []
    for right in b.T.tolist():
        found: dict[int, int] = {}
        for i in order:
            rest = graph.sub(right[i], graph.dot((rows[i][j], value) for j, value in found.items()))
            found[i] = graph.mul(rest, graph.div(one, rows[i][i]))
        columns.append([found[i] for i in range(len(rows))])
    return np.array(columns, dtype=np.int64).T


RULES: dict[str, Callable] = {
    **{
        name: _call for name in ("jit", "pjit", "closed_call", "custom_jvp_call", "custom_vjp_call", "remat2")
    },
    **{name: _method("add") for name in ("add", "add_any")},
    **{name: _method(name) for name in ("sub", "mul", "neg")},
    **{name: _operation(Op[name.upper()]) for name in ("lt", "le", "gt", "ge", "eq", "ne", "max", "min")},
    **{name: _operation(Op[name.upper()]) for name in ("abs", "sqrt", "sin", "cos", "tan")},
    **{name: _operation(Op[name.upper()]) for name in ("asin", "acos", "atan", "sinh", "cosh", "tanh")},
    **{
        name: _operation(Op[name.upper()])
        for name in ("exp", "log", "expm1", "log1p", "pow", "atan2", "cbrt")
    },
    **{name: _logical(Op[name.upper()]) for name in ("and", "or", "not")},
    **{name: lambda graph, equation, x: x for name in ("copy", "copy_p", "stop_gradient")},
    **{
        name: lambda graph, equation, x: x.reshape(equation.outvars[0].aval.shape)
        for name in ("reshape", "squeeze", "expand_dims")
    },
    "div": _quotient,
    "square": lambda graph, equation, x: _each(graph.mul, x, x),
    "rem": _remainder,
    "integer_pow": _power,
    "rsqrt": _inverse_root,
    "sign": _sign,
    "platform_index": _platform,
    "cond": _branch,
    "is_finite": _finite,
    "select_n": _select,
    "clamp": _clamp,
    "convert_element_type": _convert,
    "iota": _iota,
    "broadcast_in_dim": _broadcast,
    "transpose": lambda graph, equation, x: x.transpose(equation.params["permutation"]),
    "concatenate": lambda graph, equation, *x: np.concatenate(x, axis=equation.params["dimension"]),
    "stack": lambda graph, equation, *x: np.stack(x, axis=equation.params["axis"]),
    "rev": lambda graph, equation, x: np.flip(x, equation.params["dimensions"]),
    "slice": _slice,
    "dynamic_slice": dynamic_slice,
    "split": lambda graph, equation, x: np.split(
        x, np.cumsum(equation.params["sizes"])[:-1], axis=equation.params["axis"]
    ),
    "unstack": lambda graph, equation, x: list(np.moveaxis(x, equation.params["axis"], 0)),
    "pad": _pad,
    "reduce_sum": _sum,
    "reduce_max": _reduce(lambda graph, a, b: graph.apply(Op.MAX, a, b)),
    "reduce_min": _reduce(lambda graph, a, b: graph.apply(Op.MIN, a, b)),
    "reduce_prod": _reduce(lambda graph, a, b: graph.mul(a, b)),
    "reduce_and": _reduce(lambda graph, a, b: graph.apply(Op.AND, a, b)),
    "reduce_or": _reduce(lambda graph, a, b: graph.apply(Op.OR, a, b)),
    "argmax": _place(Op.GT),
    "argmin": _place(Op.LT),
    "cumsum": _running_sum,
    "dot_general": _product,
    "cholesky": _cholesky,
    "triangular_solve": _triangular_solve,
    "gather": gather,
    "scatter": scatter,
    "scatter-add": scatter,
    "scan": _scan,
}
"""What to do for each primitive of a jaxpr."""
