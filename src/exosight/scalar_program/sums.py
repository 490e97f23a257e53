"""Sums of products that share factors, made at once: each shared number is read once for all of them.

In a product of matrices, all entries of a row have the numbers of that row as factors.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple, no_type_check

from exosight.scalar_program.operations import Op

MOST = 3
"""Sums made at once: four or six make programs no faster."""


class Shared(NamedTuple):
    """Sums made at once.

    sums       their numbers
    operands   of each term: the shared factor, then the other one of every sum
    """

    sums: list[int]
    operands: list[int]


@no_type_check  # see conditional
def shared_sums(
    op: list[int],
    args: list[tuple[int, ...]],
    own: Sequence[int],
    guard: Mapping[int, int | None],
    apart: Collection[int],
) -> dict[int, Shared]:
    """Sums of `own` that have a factor in common in each of their terms, by the first of them.

    guard   of each value: the condition that must be known before
    apart   sums that stand alone
    """
    depth = _depths(args, own, guard)
    groups: list[tuple[list[int], list]] = []
    latest: dict[tuple, tuple[list[int], list]] = {}
    for i in own:
        if op[i] != Op.DOT or i in apart or len(args[i]) < 4:
            continue
        pairs = list(zip(args[i][::2], args[i][1::2], strict=True))
        # Of one depth, so that none depends on another, whatever else is joined.
        start = guard[i], depth[i], len(pairs)
        keys = [(*start, a, b) for a in pairs[0] for b in pairs[1]]
        for key in keys:
            sums, factors = latest.get(key, ((), ()))
            if 0 < len(sums) < MOST:
                common = [
                    [x for x in pair if x in shared] for pair, shared in zip(pairs, factors, strict=True)
                ]
                if all(common):
                    sums.append(i)
                    factors[:] = common
                    break
        else:
            groups.append(([i], pairs))
            latest |= dict.fromkeys(keys, groups[-1])
    return {
        sums[0]: Shared(sums, _operands(args, sums, [shared[0] for shared in factors]))
        for sums, factors in groups
        if len(sums) > 1
    }


@no_type_check
def _operands(args: list[tuple[int, ...]], sums: list[int], factors: list[int]) -> list[int]:
    result = []
    for term, factor in enumerate(factors):
        result.append(factor)
        for i in sums:
            a, b = args[i][2 * term : 2 * term + 2]
            result.append(b if a == factor else a)
    return result


@no_type_check
def _depths(
    args: list[tuple[int, ...]], own: Sequence[int], guard: Mapping[int, int | None]
) -> dict[int, int]:
    """How many values, one from the other, must be computed before each."""
    waits: dict[int, int] = {}
    users: dict[int, list[int]] = {i: [] for i in own}
    for i in own:
        before = {a for a in (*args[i], guard[i]) if a in users}
        waits[i] = len(before)
        for a in before:
            users[a].append(i)
    depth = dict.fromkeys(own, 0)
    ready = [i for i in own if not waits[i]]
    for i in ready:
        for user in users[i]:
            depth[user] = max(depth[user], depth[i] + 1)
            waits[user] -= 1
            if not waits[user]:
                ready.append(user)
    return depth
