"""A graph as programs for the interpreter: which operations, in which order, on which slots of memory.

A function is called with arguments that change at different rates (a design, its pose, a direction from
there). Each stage of arguments gets a program of its own, which leaves in its memory what the later ones
need, so what depends on the design alone is computed once.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Integer

from exosight.scalar_program.conditional import Arranged, arrange
from exosight.scalar_program.graph import Graph
from exosight.scalar_program.operations import DOTS, Op
from exosight.scalar_program.sums import Shared

LONGEST_RUN = 60_000
"""Operations of one kind in a row; their number has to fit in 16 bits."""

LONGEST_CHAIN = 200
"""Products of a sum that one more is joined to: it is written anew each time."""

AT_ONCE = {sums: int(op) for op, sums in DOTS.items()}
"""The operation that makes so many sums."""


class Program(NamedTuple):
    """What the interpreter runs. Slots 0, 1, … hold first the constants, then what it takes from the stage
    before, then the arguments.

    code        runs of equal operations: operation, count, terms (of DOTS or a LOOKUP), then slots of each,
                results first; before blocks: SKIP, their words (two numbers below 2¹⁶), slot of the condition
    outputs     slots of the results
    handing     slots of what the next stage takes
    constants   values of the first slots
    slots       how many there are
    """

    code: Integer[np.ndarray, " words"]
    outputs: Integer[np.ndarray, " results"]
    handing: Integer[np.ndarray, " handing"]
    constants: Float[np.ndarray, " constants"]
    slots: int


class Stage(NamedTuple):
    """Arguments that become known together, and the results wanted then, as numbers of values."""

    arguments: Sequence[int]
    results: Sequence[int]


def programs(graph: Graph, stages: Sequence[Stage]) -> list[Program]:
    """A program for each stage, from (what the stage before hands on, its own arguments) to results.

    The first stage is handed nothing.
    """
    one = graph.constant(1.0)
    op, args = list(graph.op), list(graph.args)
    level = _levels(op, args, stages)
    for number, stage in enumerate(stages):
        if any(level[value] > number for value in stage.results):
            raise ValueError(f"results of stage {number} depend on arguments of a later one")
    live = _live(op, args, stages)
    uses = Counter(a for i in live for a in args[i])
    uses.update(value for stage in stages for value in stage.results)
    live = _fuse(op, args, level, live, uses, one)
    own = [[i for i in live if op[i] >= 0 and level[i] == number] for number in range(len(stages))]
    handed: list[list[int]] = [[]]
    for number in range(1, len(stages)):
        later = {a for of_stage in own[number:] for i in of_stage for a in args[i]}
        later |= {value for after in stages[number:] for value in after.results}
        handed.append(sorted(a for a in later if op[a] != Op.CONSTANT and level[a] < number))
    made: list[Program] = []
    handing: dict[int, frozenset[int]] = {}
    # The last stage first: under which conditions it needs what it is handed.
    for number in reversed(range(len(stages))):
        stage = stages[number]
        kept = handing | dict.fromkeys(stage.results, frozenset())
        arranged = arrange(op, args, graph.known, own[number], kept, one)
        given = [*handed[number], *stage.arguments]
        made.append(_allocated(graph, op, args, arranged, given, stage.results, sorted(handing)))
        handing = {a: frozenset(c for c in arranged.handed[a] if level[c] < number) for a in handed[number]}
    return made[::-1]


def _levels(op: list[int], args: list[tuple[int, ...]], stages: Sequence[Stage]) -> list[int]:
    """The first stage at which a value can be computed."""
    level = [0] * len(op)
    for number, stage in enumerate(stages):
        for i in stage.arguments:
            level[i] = number
    for i, operands in enumerate(args):
        if op[i] >= 0:
            level[i] = max(map(level.__getitem__, operands))
    return level


def _live(op: list[int], args: list[tuple[int, ...]], stages: Sequence[Stage]) -> list[int]:
    """Values that a result depends on, in order."""
    needed = bytearray(len(op))
    for stage in stages:
        for value in stage.results:
            needed[value] = 1
    for i in range(len(op) - 1, -1, -1):
        if needed[i]:
            for a in args[i]:
                needed[a] = 1
    return [i for i in range(len(op)) if needed[i]]


def _fuse(
    op: list[int], args: list[tuple[int, ...]], level: list[int], live: list[int], uses: Counter, one: int
) -> list[int]:
    """Products, and sums of products, that only one sum uses become part of it; what is left of `live`."""
    single = {i for i in live if uses[i] == 1}
    gone = set()
    for i in live:
        if op[i] not in (Op.ADD, Op.SUB, Op.DOT):
            continue
        alike = {a for a in args[i] if a in single and level[a] == level[i]}
        own = {a for a in alike if op[a] == Op.MUL}
        if op[i] == Op.DOT:
            summands: list[int] = []
            for a, b in zip(args[i][::2], args[i][1::2], strict=True):
                factor = a if b == one else b if a == one else None
                if factor in own:
                    gone.add(factor)
                summands += args[factor] if factor in own else (a, b)
            args[i] = tuple(summands)
            continue
        a, b = args[i]
        if b not in own:
            if a not in own or op[i] == Op.SUB:
                continue
            a, b = b, a
        gone.add(b)
        x, y = args[b]
        joins = op[a] in (Op.MUL, Op.DOT) and len(args[a]) < 2 * LONGEST_CHAIN
        if a in alike and op[i] == Op.ADD and joins:
            gone.add(a)
            op[i], args[i] = int(Op.DOT), (*args[a], x, y)
        elif a in own:
            gone.add(a)
            op[i], args[i] = int(Op.DIFFERENCE), (*args[a], x, y)
        else:
            fused = Op.MULTIPLY_ADD if op[i] == Op.ADD else Op.NEGATIVE_MULTIPLY_ADD
            op[i], args[i] = int(fused), (x, y, a)
    return [i for i in live if i not in gone]


def _allocated(
    graph: Graph,
    op: list[int],
    args: list[tuple[int, ...]],
    arranged: Arranged,
    arguments: Sequence[int],
    results: Sequence[int],
    handing: Sequence[int],
) -> Program:
    """Slots for all values, and the code; a slot is used again once its value is used up."""
    blocks, instead, shared, _ = arranged
    own = [i for block in blocks for i in block.values]
    kept = {*results, *handing}
    used = {a for i in own for a in args[i]} | kept
    constants = [a for a in sorted(used) if op[a] == Op.CONSTANT]
    slot = {value: place for place, value in enumerate((*constants, *arguments))}
    asked = {block.values[0]: (block.condition,) for block in blocks if block.condition is not None}
    uses = [{*args[i], *asked.get(i, ())} for i in own]
    last = {a: place for place, operands in enumerate(uses) for a in operands}
    free, top = [], len(constants) + len(arguments)
    for place, i in enumerate(own):
        if i in instead:
            slot[i] = slot[instead[i]]
        elif free:
            slot[i] = free.pop()
        else:
            slot[i] = top
            top += 1
        free += [slot[a] for a in uses[place] if last[a] == place and a not in kept and a != instead.get(i)]
    word = np.uint16 if top < 2**16 else np.uint32
    code: list[int] = []
    for condition, values in blocks:
        of_block = _code(op, args, values, slot, shared)
        if condition is not None:
            code += [Op.SKIP, len(of_block) % 2**16, len(of_block) // 2**16, slot[condition]]
        code += of_block
    return Program(
        code=np.array(code, dtype=word),
        outputs=np.array([slot[value] for value in results], dtype=np.int32),
        handing=np.array([slot[value] for value in handing], dtype=np.int32),
        constants=np.array([graph.known[value] for value in constants]),
        slots=top,
    )


@no_type_check  # see conditional
def _code(
    op: list[int],
    args: list[tuple[int, ...]],
    order: list[int],
    slot: dict[int, int],
    shared: Mapping[int, Shared],
) -> list[int]:
    made = []
    follows = {i for i in order if i in shared for i in shared[i].sums[1:]}
    for i in order:
        if i in follows:
            continue
        results, operands = shared.get(i, ((i,), args[i]))
        kind = (op[i],)
        if op[i] == Op.DOT:
            kind = (AT_ONCE[len(results)], len(operands) // (1 + len(results)))
        elif op[i] == Op.LOOKUP:
            kind = (op[i], len(operands) - 1)
        made.append((kind, results, operands))
    code: list[int] = []
    for (operation, *size), same in groupby(made, key=itemgetter(0)):
        left = list(same)
        for start in range(0, len(left), LONGEST_RUN):
            run = left[start : start + LONGEST_RUN]
            code += [operation, len(run), *size]
            for _, results, operands in run:
                code += [slot[i] for i in results]
                code += [slot[a] for a in operands]
    return code
