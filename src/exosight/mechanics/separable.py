"""Whether a function is a sum of functions of one part of its arguments each, read off its operations.

The Hessian of such a function has a block for each part and none between them, which several directions at
once find: one in every part.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array

from exosight.scalar_program.graph import Graph, Unsupported
from exosight.scalar_program.operations import Op
from exosight.scalar_program.tracing import values_of

_LINEAR = (Op.ADD, Op.SUB, Op.NEG, Op.MAX, Op.MIN, Op.SELECT)
_WITHOUT_SLOPE = (Op.LT, Op.LE, Op.GT, Op.GE, Op.EQ, Op.NE, Op.AND, Op.OR, Op.NOT, Op.TRUNC)


def is_separable(
    function: Callable[..., Array], arguments: Sequence[Any], parts: Sequence[np.ndarray]
) -> bool:
    """Whether second derivatives of a function between different parts of its arguments are zero everywhere.

    function    (arrays) -> a number
    arguments   of which only the shapes and types count
    parts       of each argument, to which part each of its numbers belongs (0, 1, …; −1: a parameter)

    False where the operations do not tell, or it cannot be written as operations on single numbers.
    """
    graph = Graph()
    inputs = [np.array(graph.inputs(np.size(x)), dtype=np.int64).reshape(np.shape(x)) for x in parts]
    try:
        jaxpr = jax.make_jaxpr(function)(*(jax.ShapeDtypeStruct(np.shape(x), x.dtype) for x in arguments))
        (result,) = values_of(graph, jaxpr, inputs)
    except (Unsupported, jax.errors.ConcretizationTypeError, jax.errors.TracerArrayConversionError):
        return False
    on = [0] * len(graph.op)
    for numbers, belongs in zip(inputs, parts, strict=True):
        for i, part in zip(numbers.ravel().tolist(), np.ravel(belongs).tolist(), strict=True):
            on[i] = 1 << part if part >= 0 else 0
    return _unmixed(graph, on, int(result))


def _unmixed(graph: Graph, on: list[int], result: int) -> bool:
    """Whether nothing that the result depends on mixes parts; `on`: those of each value, as bits."""
    mixed = [False] * len(graph.op)
    for i, operands in enumerate(graph.args):
        op = graph.op[i]
        if op < 0 or op in _WITHOUT_SLOPE:
            continue
        slopes = operands[1:] if op in (Op.SELECT, Op.LOOKUP) else operands
        together = 0
        for a in slopes:
            together |= on[a]
        on[i] = together
        mixed[i] = any(mixed[a] for a in slopes)
        if op == Op.DOT:
            pairs = zip(operands[::2], operands[1::2], strict=True)
            mixed[i] |= any(on[a] and on[b] and _several(on[a] | on[b]) for a, b in pairs)
        elif op == Op.MUL:
            mixed[i] |= bool(_several(together) and on[operands[0]] and on[operands[1]])
        elif op == Op.DIV:
            mixed[i] |= bool(_several(together) and on[operands[1]])
        elif op not in _LINEAR and op != Op.LOOKUP:
            mixed[i] |= _several(together)
    return not mixed[result]


def _several(parts: int) -> bool:
    return bool(parts & (parts - 1))
