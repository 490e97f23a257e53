"""A function as operations on single numbers, each made once.

Zeros, ones and numbers that are known beforehand disappear as the operations are added; equal operations on
equal arguments are one.
"""

from collections.abc import Iterable, Sequence
from math import copysign
from typing import no_type_check

import numpy as np

from exosight.scalar_program.operations import FOLD, Op

TOO_MANY = 3_000_000
"""Operations of a graph: beyond, unrolling a function is not worth its time and memory."""

LONGEST_DOT = 10_000
"""Products of one sum, and numbers of one table: how many has to fit in 16 bits."""


class Unsupported(Exception):
    """The function cannot be written as operations on single numbers."""


@no_type_check  # called a million times: the tests would spend longer on checking types at run time
class Graph:
    """Values are numbered; `op[i]` and `args[i]` say how value i is made, `known` which are numbers."""

    def __init__(self) -> None:
        self.op: list[int] = []
        self.args: list[tuple[int, ...]] = []
        self.known: dict[int, float] = {}
        self._made: dict[tuple, int] = {}
        self._number: dict[tuple[float, float], int] = {}

    def _new(self, op: int, args: tuple[int, ...]) -> int:
        made = self._made.get((op, args))
        if made is None:
            made = self._made[op, args] = len(self.op)
            self.op.append(op)
            self.args.append(args)
            if made > TOO_MANY:
                raise Unsupported(f"more than {TOO_MANY} operations")
        return made

    def inputs(self, count: int) -> range:
        """So many new inputs."""
        start = len(self.op)
        self.op += [int(Op.INPUT)] * count
        self.args += [()] * count
        return range(start, start + count)

    def constant(self, value: float) -> int:
        """A number that is known beforehand."""
        value = float(value)
        key = value, copysign(1.0, value)
        number = self._number.get(key)
        if number is None:
            number = self._number[key] = len(self.op)
            self.op.append(int(Op.CONSTANT))
            self.args.append(())
            self.known[number] = value
        return number

    def zeros(self) -> list[int]:
        """The values that are known to be zero."""
        return [self._number[key] for key in ((0.0, 1.0), (0.0, -1.0)) if key in self._number]

    def apply(self, op: Op, *args: int) -> int:
        """An operation without rules of its own."""
        known = self.known
        for a in args:
            if a not in known:
                return self._new(int(op), args)
        with np.errstate(all="ignore"):
            return self.constant(float(FOLD[op](*(known[a] for a in args))))

    def neg(self, a: int) -> int:
        """−a."""
        if a in self.known:
            return self.constant(-self.known[a])
        if self.op[a] == Op.NEG:
            return self.args[a][0]
        return self._new(int(Op.NEG), (a,))

    def add(self, a: int, b: int) -> int:
        """a + b."""
        x, y = self.known.get(a), self.known.get(b)
        if x is not None and y is not None:
            return self.constant(x + y)
        if x == 0:
            return b
        if y == 0:
            return a
        if self.op[b] == Op.NEG:
            return self.sub(a, self.args[b][0])
        if self.op[a] == Op.NEG:
            return self.sub(b, self.args[a][0])
        return self._new(int(Op.ADD), (a, b) if a < b else (b, a))

    def sub(self, a: int, b: int) -> int:
        """a − b."""
        x, y = self.known.get(a), self.known.get(b)
        if x is not None and y is not None:
            return self.constant(x - y)
        if y == 0:
            return a
        if x == 0:
            return self.neg(b)
        if a == b:
            return self.constant(0.0)
        if self.op[b] == Op.NEG:
            return self.add(a, self.args[b][0])
        return self._new(int(Op.SUB), (a, b))

    def mul(self, a: int, b: int) -> int:
        """a b."""
        x, y = self.known.get(a), self.known.get(b)
        if x is not None and y is not None:
            return self.constant(x * y)
        if x == 0 or y == 0:
            return self.constant(0.0)
        for one, other in ((x, b), (y, a)):
            if one == 1:
                return other
            if one == -1:
                return self.neg(other)
        if self.op[a] == Op.NEG:
            return self.neg(self.mul(self.args[a][0], b))
        if self.op[b] == Op.NEG:
            return self.neg(self.mul(a, self.args[b][0]))
        return self._new(int(Op.MUL), (a, b) if a < b else (b, a))

    def div(self, a: int, b: int) -> int:
        """a / b."""
        y = self.known.get(b)
        if y is not None and y != 0 and a not in self.known:
            return self.mul(a, self.constant(1 / y))
        if self.known.get(a) == 0:
            return a
        return self.apply(Op.DIV, a, b)

    def dot(self, pairs: Iterable[tuple[int, int]]) -> int:
        """The sum of the products of pairs."""
        known, kept, offset = self.known, [], 0.0
        for a, b in pairs:
            x, y = known.get(a), known.get(b)
            if x == 0 or y == 0:
                continue
            if x is not None and y is not None:
                offset += x * y
            else:
                kept.append((a, b) if a < b else (b, a))
        if len(kept) < 3:
            whole = self.constant(offset)
            for a, b in kept:
                whole = self.add(whole, self.mul(a, b))
            return whole
        if len(kept) > LONGEST_DOT:
            return self.add(self.dot(kept[:LONGEST_DOT]), self.dot(kept[LONGEST_DOT:]))
        whole = self._new(int(Op.DOT), tuple(value for pair in kept for value in pair))
        return self.add(whole, self.constant(offset)) if offset else whole

    def select(self, condition: int, yes: int, no: int) -> int:
        """`yes` where the condition is not zero, else `no`."""
        if condition in self.known:
            return yes if self.known[condition] else no
        return yes if yes == no else self._new(int(Op.SELECT), (condition, yes, no))

    def lookup(self, index: int, table: Sequence[int]) -> int:
        """The value of a table at a place that depends on the arguments; outside, the nearest."""
        if index in self.known:
            return table[int(np.clip(self.known[index], 0, len(table) - 1))]
        if len(table) > LONGEST_DOT:
            raise Unsupported(f"a table of {len(table)} numbers")
        return table[0] if len(set(table)) == 1 else self._new(int(Op.LOOKUP), (index, *table))
