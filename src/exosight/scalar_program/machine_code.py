"""What the interpreter's machine code is written with: types, loops, variables."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

from llvmlite import ir

Builder: TypeAlias = Any
Value: TypeAlias = Any
"""llvmlite's types of its own objects are too wide to check calls by."""

WORD, LONG = ir.IntType(32), ir.IntType(64)
DOUBLE, POINTER = ir.DoubleType(), ir.IntType(8).as_pointer()


def variable(b: Builder, kind: ir.Type) -> Value:
    """A place for a value that changes, in the function's first block: made once, kept in a register."""
    with b.goto_entry_block():
        return b.alloca(kind)


@contextmanager
def loop(b: Builder, count: Value) -> Iterator[Value]:
    """A loop over 0, 1, … count − 1; yields the index."""
    start, head = b.block, b.append_basic_block("head")
    body, done = b.append_basic_block("body"), b.append_basic_block("done")
    b.branch(head)
    b.position_at_end(head)
    index = b.phi(LONG)
    index.add_incoming(LONG(0), start)
    b.cbranch(b.icmp_signed("<", index, count), body, done)
    b.position_at_end(body)
    yield index
    index.add_incoming(b.add(index, LONG(1)), b.block)
    b.branch(head)
    b.position_at_end(done)


def spread(b: Builder, number: Value, vector: ir.VectorType) -> Value:
    """The same number in all lanes."""
    result = ir.Constant(vector, ir.Undefined)
    for lane in range(vector.count):
        result = b.insert_element(result, number, WORD(lane))
    return result
