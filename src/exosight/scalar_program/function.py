"""Functions of arguments that become known one after the other, unrolled and called from JAX."""

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Integer

from exosight.arrays import AnyArray
from exosight.call_stack import with_room_for_frames
from exosight.scalar_program import interpreter
from exosight.scalar_program.cache import kept_programs
from exosight.scalar_program.graph import Graph, Unsupported
from exosight.scalar_program.program import Program, Stage, programs
from exosight.scalar_program.tracing import values_of


class Held(NamedTuple):
    """What a program has left in its memory for the next one: the numbers in these slots.

    The layout of the memory is the interpreter's own, so robots in lanes cannot be told apart there; as a row
    of numbers, it can be kept, and put into another lane.
    """

    memory: Float[AnyArray, " memory"]
    slots: Integer[np.ndarray, " numbers"]

    @classmethod
    def of(cls, row: Float[AnyArray, " numbers"]) -> "Held":
        """A row of numbers, put into memory."""
        places = np.arange(len(row), dtype=np.int32)
        return cls(_run(_without_operations(len(row), places[:0]), None, row)[1], places)

    @property
    def row(self) -> Float[Array, " numbers"]:
        """The numbers."""
        places = np.arange(len(self.slots), dtype=np.int32)
        return _run(_without_operations(len(places), places), self, jnp.zeros(0))[0]


@dataclass(frozen=True, eq=False)
class Unrolled:
    """Programs of the stages of a function, with the shapes of their results."""

    stages: tuple[Program, ...]
    results: tuple[Any, ...]

    def __call__(self, stage: int, before: Held | None, arguments: Any) -> tuple[Any, Held]:
        """The results of a stage, and what it leaves for the next.

        before      what the stage before left; none for the first
        arguments   the stage's own
        """
        program = self.stages[stage]
        flat = jnp.concatenate([jnp.reshape(x, -1) for x in jax.tree.leaves(arguments)])
        values, memory = _run(program, before, flat)
        leaves, structure = jax.tree.flatten(self.results[stage])
        parts, at = [], 0
        for leaf in leaves:
            parts.append(values[at : at + leaf.size].reshape(leaf.shape).astype(leaf.dtype))
            at += leaf.size
        return jax.tree.unflatten(structure, parts), Held(memory, program.handing)


def _without_operations(slots: int, outputs: Integer[np.ndarray, " results"]) -> Program:
    """A program that moves numbers alone."""
    return Program(np.zeros(0, np.uint16), outputs, outputs[:0], np.zeros(0), slots)


def _run(
    program: Program, before: Held | None, arguments: Float[AnyArray, " arguments"]
) -> tuple[Float[Array, " results"], Float[Array, " memory"]]:
    """Results and memory of a program."""
    kinds = [
        jax.ShapeDtypeStruct((size,), np.float64)
        for size in (len(program.outputs), interpreter.memory(program.slots))
    ]
    memory, taken = (np.zeros(1), np.zeros(0, np.int32)) if before is None else before
    target = interpreter.TARGETS[8 * program.code.dtype.itemsize]
    call = jax.ffi.ffi_call(target, kinds, vmap_method="expand_dims")
    results, left = call(program.code, program.outputs, program.constants, taken, memory, arguments)
    return results, left


@with_room_for_frames
def unroll(function: Callable, arguments: Sequence[Any]) -> Unrolled:
    """A function whose arguments become known one after the other, as programs.

    function    (one argument a stage) -> the results of each stage, which depend on no later argument
    arguments   of each stage: float arrays in any structure, of which only the shapes count

    Raises Unsupported for what cannot be written as operations on single numbers, or without an interpreter.
    """
    if why := interpreter.obstacle():
        raise Unsupported(why)
    flat, structure = jax.tree.flatten(tuple(arguments))
    jaxpr, results = jax.make_jaxpr(
        lambda *leaves: function(*jax.tree.unflatten(structure, leaves)), return_shape=True
    )(*(jax.ShapeDtypeStruct(np.shape(x), np.float64) for x in flat))
    sizes = [
        (len(jax.tree.leaves(a)), len(jax.tree.leaves(b))) for a, b in zip(arguments, results, strict=True)
    ]

    def make() -> list[Program]:
        graph = Graph()
        inputs = [np.array(graph.inputs(int(np.prod(np.shape(x)))), dtype=np.int64) for x in flat]
        inputs = [own.reshape(np.shape(x)) for own, x in zip(inputs, flat, strict=True)]
        given = jax.tree.unflatten(structure, inputs)
        with _no_garbage_collection():
            found = jax.tree.unflatten(jax.tree.structure(results), values_of(graph, jaxpr, inputs))
            stages = [Stage(_numbers(a), _numbers(b)) for a, b in zip(given, found, strict=True)]
            return programs(graph, stages)

    return Unrolled(tuple(kept_programs(jaxpr, sizes, make)), tuple(results))


def call_unrolled(function: Callable, *arguments: Any) -> Any:
    """The results of a function of arrays, by its program where it has one, else by JAX.

    function    known by its identity: its program is made once for arguments of these shapes
    arguments   arrays in any structure: numbers, whole numbers and truth values
    """
    leaves, structure = jax.tree.flatten(arguments)
    program = _program(function, structure, tuple((jnp.shape(x), jnp.result_type(x)) for x in leaves))
    if program is None:
        return function(*arguments)
    return program(0, None, [jnp.asarray(x, float) for x in leaves])[0]


@lru_cache(maxsize=64)
def _program(
    function: Callable, structure: Any, kinds: Sequence[tuple[tuple[int, ...], Any]]
) -> Unrolled | None:
    """The program of a function of arrays, given as numbers; None where there is none."""

    def of_numbers(leaves: list[Array]) -> tuple[Any]:
        given = [x.astype(dtype) for x, (_, dtype) in zip(leaves, kinds, strict=True)]
        return (function(*jax.tree.unflatten(structure, given)),)

    try:
        return unroll(of_numbers, [[np.zeros(shape) for shape, _ in kinds]])
    except Unsupported:
        return None


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """A graph is a million tuples without cycles: looking for cycles takes a fifth of the time."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def _numbers(values: Any) -> list[int]:
    """The numbers of all values of a structure of arrays."""
    return [number for array in jax.tree.leaves(values) for number in array.ravel().tolist()]
