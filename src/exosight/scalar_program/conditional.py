"""What matters only under a condition, as blocks that the interpreter skips where it holds in no sample.

In `where(touches, force, 0)` the force matters only where a point touches something, which of many points
few do at a time. What such choices alone need is moved into a block behind its condition. A sum that such a
choice is added to becomes part of the block, in the place of what it is added to: where the block is
skipped, that stays as it was.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from heapq import heapify, heappop, heappush
from typing import NamedTuple

from exosight.scalar_program.operations import Op

LEAST = 12
"""Operations that pay for asking whether to skip them: a processor may guess the answer wrong."""

SUMS = (Op.ADD, Op.SUB, Op.DOT, Op.MULTIPLY_ADD, Op.NEGATIVE_MULTIPLY_ADD)


class Block(NamedTuple):
    """Values to be computed in this order, unless there is a `condition` and it holds in no sample."""

    condition: int | None
    values: list[int]


class Arranged(NamedTuple):
    """All blocks, and of sums in the place of another value, that value."""

    blocks: list[Block]
    instead: dict[int, int]


class _Addition(NamedTuple):
    """Of a sum: without `condition`, it is equal to the value `to`."""

    condition: int
    to: int


def arrange(
    op: list[int],
    args: list[tuple[int, ...]],
    known: Mapping[int, float],
    own: Sequence[int],
    kept: Collection[int],
    one: int,
) -> Arranged:
    """Blocks of the values `own`, which stand in an order in which they can be computed.

    op, args   how values are made; long sums become several, whose values are added to both
    known      numbers known beforehand
    kept       values wanted in the end
    one        number of the value 1
    """
    own, additions = _additions(op, args, known, own, one)
    users: dict[int, set[int]] = defaultdict(set)
    for i in own:
        for a in args[i]:
            users[a].add(i)
    here = set(own)
    additions = {
        i: addition
        for i, addition in additions.items()
        if addition.to in here
        and addition.to not in kept
        and users[addition.to] == {i}
        and args[i].count(addition.to) == 1
    }
    need = _needed(op, args, own, kept, additions)
    size = {i: len(args[i]) // 2 if op[i] == Op.DOT else 1 for i in own}
    weight: Counter[int] = Counter()
    for i in own:
        for c in need[i]:
            weight[c] += size[i]
        if i in additions:
            weight[additions[i].condition] += size[i]
    guard: dict[int, int | None] = {}
    for i in own:
        # That which least depends on holds most rarely.
        guard[i] = min((c for c in need[i] if weight[c] >= LEAST), key=lambda c: (weight[c], c), default=None)
    additions = {i: addition for i, addition in additions.items() if weight[addition.condition] >= LEAST}
    guard |= {i: addition.condition for i, addition in additions.items()}
    blocks = _blocks(args, own, guard, users)
    for at, (_, values) in enumerate(blocks):
        # What another block of the same condition left out must not be added.
        if sum(size[i] for i in values) < LEAST and additions.keys().isdisjoint(values):
            blocks[at] = Block(None, values)
    return Arranged(blocks, {i: addition.to for i, addition in additions.items()})


def _additions(
    op: list[int],
    args: list[tuple[int, ...]],
    known: Mapping[int, float],
    own: Sequence[int],
    one: int,
) -> tuple[list[int], dict[int, _Addition]]:
    """All values, with those of shorter sums, and which sums add what is zero without a condition."""
    choices = {i for i in own if op[i] == Op.SELECT and known.get(args[i][2]) == 0}
    often: Counter[int | None] = Counter(
        args[a][0] for i in own if op[i] in SUMS for a in choices.intersection(args[i])
    )

    def condition(*values: int) -> int | None:
        """Without which a product is zero; first of factors that are more than 0 or 1."""
        found = None
        for value in values:
            if value in choices and (found is None or args[value][1] not in known):
                found = args[value][0]
        return found if often[found] >= LEAST else None

    result: list[int] = []
    additions: dict[int, _Addition] = {}
    for i in own:
        x = args[i]
        if op[i] == Op.DOT:
            _split(op, args, i, one, condition, result, additions)
        elif op[i] in SUMS:
            # The last summand of ADD and SUB, or the product of the two others; either summand of ADD.
            first, rest = (x[2], x[:2]) if len(x) == 3 else (x[0], x[1:])
            if op[i] == Op.ADD and condition(*rest) is None:
                first, rest = x[1], x[:1]
            only = condition(*rest)
            if only is not None:
                additions[i] = _Addition(only, first)
        result.append(i)
    return result, additions


def _split(
    op: list[int],
    args: list[tuple[int, ...]],
    i: int,
    one: int,
    condition: Callable[..., int | None],
    result: list[int],
    additions: dict[int, _Addition],
) -> None:
    """A sum of products as one of those that always count, and one more for each condition."""
    parts: dict[int | None, list[int]] = {None: []}
    x = args[i]
    for a, b in zip(x[::2], x[1::2], strict=True):
        parts.setdefault(condition(a, b), []).extend((a, b))
    if not parts[None]:
        del parts[None]
    if None not in parts and len(parts) == 1:
        return
    total = None
    for left, (only, values) in zip(range(len(parts) - 1, -1, -1), parts.items(), strict=True):
        kind, operands = _sum(values, total, one)
        if left == 0:
            into, op[i], args[i] = i, int(kind), operands
        else:
            into = len(op)
            op.append(int(kind))
            args.append(operands)
            result.append(into)
        if only is not None and total is not None:
            additions[into] = _Addition(only, total)
        total = into


def _sum(values: Sequence[int], total: int | None, one: int) -> tuple[Op, tuple[int, ...]]:
    """A sum of products of pairs of values, and of a total."""
    if total is None:
        return Op.DOT, tuple(values)
    if len(values) > 2:
        return Op.DOT, (*values, total, one)
    a, b = values
    if one in values:
        return Op.ADD, (total, b if a == one else a)
    return Op.MULTIPLY_ADD, (a, b, total)


def _needed(
    op: list[int],
    args: list[tuple[int, ...]],
    own: Sequence[int],
    kept: Collection[int],
    additions: Mapping[int, _Addition],
) -> dict[int, frozenset[int]]:
    """The conditions without any of which nobody needs a value."""
    none: frozenset[int] = frozenset()
    need = dict.fromkeys(kept, none)
    for i in reversed(own):
        if i not in need:
            need[i] = none  # a choice of no use any more
        need[i] -= {i}
        for a in set(args[i]):
            only = need[i]
            if i in additions:
                if a != additions[i].to:
                    only = only | {additions[i].condition}
            elif op[i] == Op.SELECT and a == args[i][1] and args[i].count(a) == 1:
                only = only | {args[i][0]}
            need[a] = need[a] & only if a in need else only
    return need


def _blocks(
    args: list[tuple[int, ...]],
    own: Sequence[int],
    guard: Mapping[int, int | None],
    users: Mapping[int, Collection[int]],
) -> list[Block]:
    """What is always needed, as far as it can be computed, then the first block that can be; and so on."""
    place = {i: at for at, i in enumerate(own)}
    waits = {i: len({a for a in args[i] if a in place}) for i in own}
    later: dict[int, list[int]] = defaultdict(list)
    for i in own:
        condition = guard[i]
        if condition in place and condition not in args[i]:
            later[condition].append(i)
            waits[i] += 1
    ready: dict[int | None, list[int]] = defaultdict(list)
    for i in own:
        if not waits[i]:
            ready[guard[i]].append(place[i])
    blocks = []
    while ready:
        # In the order of conditions: sums over them are in this order, so that one block does for all.
        condition = None if None in ready else min(c for c in ready if c is not None)
        block = Block(condition, [])
        queue = ready[condition]
        heapify(queue)
        while queue:
            i = own[heappop(queue)]
            block.values.append(i)
            for user in (*users.get(i, ()), *later.get(i, ())):
                waits[user] -= 1
                if not waits[user]:
                    heappush(ready[guard[user]], place[user])
        del ready[condition]
        blocks.append(block)
    return blocks
