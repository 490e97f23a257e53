"""Functions of arguments that become known one after the other, unrolled and called from JAX."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from exosight.arrays import AnyArray
from exosight.scalar_program import interpreter
from exosight.scalar_program.graph import Graph, Unsupported
from exosight.scalar_program.program import Program, Stage, programs
from exosight.scalar_program.tracing import trace


@dataclass(frozen=True, eq=False)
class Unrolled:
    """Programs of the stages of a function, with the shapes of their results."""

    stages: tuple[Program, ...]
    results: tuple[Any, ...]

    def __call__(
        self, stage: int, handed: Float[AnyArray, " handed"] | None, arguments: Any
    ) -> tuple[Any, Float[AnyArray, " handing"]]:
        """The results of a stage, and what it hands on.

        handed      what the stage before handed on; none for the first
        arguments   the stage's own
        """
        program, shapes = self.stages[stage], self.results[stage]
        flat = jnp.concatenate([jnp.ravel(x) for x in jax.tree.leaves(arguments)])
        given = [flat] if handed is None else [handed, flat]
        kinds = [
            jax.ShapeDtypeStruct((size,), np.float64)
            for size in (len(program.outputs), interpreter.memory(program.slots))
        ]
        target = interpreter.TARGETS[8 * program.code.dtype.itemsize]
        call = jax.ffi.ffi_call(target, kinds, vmap_method="expand_dims")
        values, _ = call(program.code, program.outputs, program.constants, *given)
        leaves, structure = jax.tree.flatten(shapes)
        parts, at = [], 0
        for leaf in leaves:
            parts.append(values[at : at + leaf.size].reshape(leaf.shape))
            at += leaf.size
        return jax.tree.unflatten(structure, parts), values[at:]


def unroll(functions: Sequence[Callable], arguments: Sequence[Any]) -> Unrolled:
    """Functions of stages of arguments as programs.

    functions   each takes the arguments of its own stage and of all before, and returns that stage's results
    arguments   of each stage: float arrays in any structure, of which only the shapes count

    Raises Unsupported for what cannot be written as operations on single numbers, or without an interpreter.
    """
    if why := interpreter.obstacle():
        raise Unsupported(why)
    graph = Graph()
    flat, stages, results = [], [], []
    for number, function in enumerate(functions):
        leaves = [np.shape(x) for x in jax.tree.leaves(arguments[number])]
        own = [np.array(graph.inputs(int(np.prod(s))), dtype=np.int64).reshape(s) for s in leaves]
        flat += own
        structure = jax.tree.structure(tuple(arguments[: number + 1]))

        def on_leaves(*leaves: Any, structure: Any = structure, function: Callable = function) -> Any:
            return function(*jax.tree.unflatten(structure, leaves))

        found, shapes = trace(graph, on_leaves, flat)
        results.append(shapes)
        stages.append(
            Stage(
                [i for x in own for i in x.ravel().tolist()],
                [i for x in found for i in x.ravel().tolist()],
            )
        )
    return Unrolled(tuple(programs(graph, stages)), tuple(results))
