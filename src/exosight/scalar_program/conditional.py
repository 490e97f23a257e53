"""What matters only under a condition, as blocks that the interpreter skips where it holds in no sample.

In `where(touches, force, 0)` the force matters only where a point touches something, which of many points
few do at a time. What such choices alone need is moved into a block behind its condition. A sum that such a
choice is added to becomes part of the block, in the place of what it is added to: where the block is
skipped, that stays as it was.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from heapq import heappop, heappush
from typing import NamedTuple, no_type_check

from exosight.scalar_program.operations import FOLD, Op
from exosight.scalar_program.sums import Shared, shared_sums

LEAST = 12
"""Operations that pay for asking whether to skip them: a processor may guess the answer wrong."""

CLOSE = 200
"""Places by which operations of one kind are moved together: a processor guesses the next kind wrong, but
what is computed long before its use leaves the cache."""

# Functions that are called for every operation are not checked at run time by the tests, which would take
# longer than what they do.

ALWAYS = -1
"""In the place of a condition: before all others."""

COMPARISONS = (Op.LT, Op.LE, Op.GT, Op.GE, Op.EQ)

SUMS = (Op.ADD, Op.SUB, Op.DOT, Op.MULTIPLY_ADD, Op.NEGATIVE_MULTIPLY_ADD)


class Block(NamedTuple):
    """Values to be computed in this order, unless there is a `condition` and it holds in no sample."""

    condition: int | None
    values: list[int]


class Arranged(NamedTuple):
    """Values in their order.

    blocks    all of them
    instead   of sums in the place of another value, that value
    shared    sums made at once, by the first
    handed    of values made before: conditions without any of which nobody needs them
    """

    blocks: list[Block]
    instead: dict[int, int]
    shared: dict[int, Shared]
    handed: dict[int, frozenset[int]]


class _Addition(NamedTuple):
    """Of a sum: without `condition`, it is equal to the value `to`."""

    condition: int
    to: int


def arrange(
    op: list[int],
    args: list[tuple[int, ...]],
    known: Mapping[int, float],
    own: Sequence[int],
    kept: Mapping[int, Collection[int]],
    one: int,
) -> Arranged:
    """Blocks of the values `own`, which stand in an order in which they can be computed.

    op, args   how values are made; long sums become several, whose values are added to both
    known      numbers known beforehand
    kept       values wanted in the end, with the conditions without any of which nobody needs them
    one        number of the value 1
    """
    own, additions = _additions(op, args, known, own, one)
    here = set(own)
    before = {a for i in own for a in args[i] if a not in here} | (kept.keys() - here)
    uses = Counter(a for i in own for a in set(args[i]))
    additions = {
        i: addition
        for i, addition in additions.items()
        if addition.to in here
        and addition.to not in kept
        and uses[addition.to] == 1
        and args[i].count(addition.to) == 1
    }
    size = {i: len(args[i]) // 2 if op[i] == Op.DOT else 1 for i in own}
    conditions, need = _needed(op, args, known, own, kept, additions)
    weight: Counter[int] = Counter()
    alike: Counter[int] = Counter()
    for i in own:
        alike[need[i]] += size[i]
    for bits, total in alike.items():
        for c in _of(bits, conditions):
            weight[c] += total
    for i, addition in additions.items():
        weight[addition.condition] += size[i]
    # That which least depends on holds most rarely.
    rarest = {
        bits: min(
            (c for c in _of(bits, conditions) if weight[c] >= LEAST and (c in here or c in before)),
            key=lambda c: (weight[c], c),
            default=None,
        )
        for bits in alike
    }
    guard = {i: rarest[need[i]] for i in own}
    additions = {i: addition for i, addition in additions.items() if weight[addition.condition] >= LEAST}
    guard |= {i: addition.condition for i, addition in additions.items()}
    shared = shared_sums(op, args, own, guard, additions)
    blocks = _blocks(op, args, own, guard, shared)
    for at, (_, values) in enumerate(blocks):
        # What another block of the same condition left out must not be added.
        if sum(size[i] for i in values) < LEAST and additions.keys().isdisjoint(values):
            blocks[at] = Block(None, values)
    # A sum in which another sample of this stage has a block run adds zero times what it was handed, which
    # must be a number: only choices leave out what nobody computed.
    conditions, need = _needed(op, args, known, own, kept, {})
    sets = {bits: frozenset(_of(bits, conditions)) for bits in {need[a] for a in before}}
    return Arranged(
        blocks,
        {i: addition.to for i, addition in additions.items()},
        shared,
        {a: sets[need[a]] for a in before},
    )


@no_type_check
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
        if choices.isdisjoint(x):
            pass
        elif op[i] == Op.DOT:
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


@no_type_check
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


@no_type_check
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


@no_type_check
def _needed(
    op: list[int],
    args: list[tuple[int, ...]],
    known: Mapping[int, float],
    own: Sequence[int],
    kept: Mapping[int, Collection[int]],
    additions: Mapping[int, _Addition],
) -> tuple[list[int], list[int]]:
    """Conditions, and of every value those without any of which nobody needs it, as bits of a number."""
    conditions: list[int] = []
    bit: dict[int, int] = {}
    bits: dict[int, int] = {}

    def bits_of(condition: int) -> int:
        """With those that hold wherever this one does."""
        if condition not in bits:
            bit[condition] = 1 << len(conditions)
            conditions.append(condition)
            bits[condition] = bit[condition]
            for other in _implied(op, args, known, condition):
                bits[condition] |= bits_of(other)
        return bits[condition]

    every = -1  # of what nobody has asked for yet
    need = [every] * len(op)
    shared: dict[int, int] = {}

    def ask(value: int, only: int) -> None:
        """Numbers of thousands of bits are kept once for all values that have the same."""
        before = need[value]
        if before == every:
            need[value] = shared.setdefault(only, only)
        elif before is not only and before:
            both = before & only
            need[value] = shared.setdefault(both, both)

    for i, only in kept.items():
        need[i] = 0
        for condition in only:
            need[i] |= bits_of(condition)
    for i in reversed(own):
        only = need[i]
        if only == every:
            only = 0  # a choice of no use any more
        elif i in bit and only & bit[i]:
            only &= ~bit[i]
        need[i] = only
        operands = args[i]
        if i in additions:
            always, within = additions[i].to, only | bits_of(additions[i].condition)
            for a in operands:
                ask(a, only if a == always else within)
            ask(additions[i].condition, only)
        elif op[i] == Op.SELECT and operands.count(operands[1]) == 1:
            condition, chosen, other = operands
            ask(condition, only)
            ask(chosen, only | bits_of(condition))
            ask(other, only)
        else:
            for a in operands:
                ask(a, only)
    return conditions, need


@no_type_check
def _implied(
    op: list[int], args: list[tuple[int, ...]], known: Mapping[int, float], condition: int
) -> list[int]:
    """Conditions without which this one does not hold: in `where(near, depth, -1) > 0`, `near`."""
    if op[condition] == Op.AND:
        return [a for a in args[condition] if a not in known]
    if op[condition] not in COMPARISONS:
        return []
    x, y = args[condition]
    found = []
    for choice, number, order in ((x, y, 1), (y, x, -1)):
        if op[choice] == Op.SELECT and number in known and args[choice][2] in known:
            values = (known[args[choice][2]], known[number])[::order]
            if not FOLD[op[condition]](*values):
                found.append(args[choice][0])
    return found


@no_type_check
def _of(bits: int, conditions: Sequence[int]) -> Iterator[int]:
    """The conditions that the bits of a number stand for."""
    while bits:
        yield conditions[(bits & -bits).bit_length() - 1]
        bits &= bits - 1


@no_type_check
def _blocks(
    op: list[int],
    args: list[tuple[int, ...]],
    own: Sequence[int],
    guard: Mapping[int, int | None],
    shared: Mapping[int, Shared],
) -> list[Block]:
    """What is always needed, as far as it can be computed, then the first block that can be; and so on.

    Within a block, operations of one kind follow each other as far as they stand close to each other.
    """
    follows = {i: first for first, group in shared.items() for i in group.sums[1:]}
    own = [i for i in own if i not in follows]
    place = {i: at for at, i in enumerate(own)}
    place |= {i: place[first] for i, first in follows.items()}
    waits = [0] * len(own)
    users: list[list[int]] = [[] for _ in own]
    for at, i in enumerate(own):
        operands = shared[i].operands if i in shared else args[i]
        before = {place[a] for a in (*operands, guard[i]) if a in place}
        waits[at] = len(before)
        for one in before:
            users[one].append(at)
    # In the order of conditions: sums over them are in this order, so that one block does for all.
    conditions = (guard[i] for i in own)
    group = [ALWAYS if condition is None else condition for condition in conditions]
    kind = [(op[i], len(args[i]), len(shared[i].sums) if i in shared else 1) for i in own]
    ready: dict[int, dict[tuple[int, int, int], list[int]]] = {}
    waiting: list[int] = []

    def add(at: int) -> None:
        if group[at] not in ready:
            ready[group[at]] = {}
            heappush(waiting, group[at])
        heappush(ready[group[at]].setdefault(kind[at], []), at)

    for at, count in enumerate(waits):
        if not count:
            add(at)
    blocks = []
    while waiting:
        condition = heappop(waiting)
        kinds, values = ready[condition], []
        while kinds:
            first = min(kinds, key=lambda kind: kinds[kind][0])
            alike = kinds[first]
            end = alike[0] + CLOSE
            while alike and alike[0] <= end:
                at = heappop(alike)
                values += shared[own[at]].sums if own[at] in shared else (own[at],)
                for user in users[at]:
                    waits[user] -= 1
                    if not waits[user]:
                        add(user)
            if not alike:
                del kinds[first]
        del ready[condition]
        blocks.append(Block(None if condition == ALWAYS else condition, values))
    return blocks
