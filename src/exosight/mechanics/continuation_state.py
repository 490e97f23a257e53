"""Where one robot is on its quasi-static path, and what has been found on it so far."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.mechanics.branch import Anchor, Beyond
from exosight.mechanics.descent import UPHILL, Descent
from exosight.mechanics.energy import Evaluation
from exosight.mechanics.term import Memories

TO_LOAD, ALONG, DESCEND = 0, 1, 2
"""Phases: Newton's method at a given load, at a given length along the branch, and descent."""

SNAPS = 16
"""Room for snaps; all lanes are handed back when one has used it."""


class OfLoad(NamedTuple):
    """What was found at a load.

    memories   what the terms of the robot remember there
    supplied   what changing loads gave on the way there [J], and what was dissipated
    """

    q: Float[AnyArray, "*loads dofs"]
    energy: Float[AnyArray, "*loads"]
    supplied: Float[AnyArray, "*loads"]
    dissipated: Float[AnyArray, "*loads"]
    residual: Float[AnyArray, "*loads"]
    iterations: Int[AnyArray, "*loads"]
    converged: Bool[AnyArray, "*loads"]
    snapped: Bool[AnyArray, "*loads"]
    tied: Bool[AnyArray, "*loads"]
    load: Float[AnyArray, "*loads channels"]
    memories: tuple[Float[AnyArray, "..."], ...]


class OfSnap(NamedTuple):
    """A snap: on the way to which load, the load of it [N], the poses before and after.

    released   the energy set free [J]
    taken      what terms with a memory took of it [J]
    """

    step: Int[AnyArray, "*snaps"]
    load: Float[AnyArray, "*snaps channels"]
    before: Float[AnyArray, "*snaps dofs"]
    after: Float[AnyArray, "*snaps dofs"]
    released: Float[AnyArray, "*snaps"]
    taken: Float[AnyArray, "*snaps"]


class ContinuationState(NamedTuple):
    """Where one robot is.

    load, steps    index of the load it is on the way to (their number once done), evaluations spent on that
    snaps          how many have been recorded
    phase, tries   see TO_LOAD …, and evaluations spent on the present trial
    origin         loads at the start of the present segment [N]
    q, t           trial point: pose, and where on the segment
    s, growth      length along the branch that is aimed at (ALONG), and how much longer the next may be;
                   0 where it led past the load
    previous       of the Newton step before: the tangent there, and the length of its correction
    memories       what the terms remember: from the anchor, or from the last point of a descent
    snap           the present descent is from the end of a branch
    nudge          how far past the end of the branch the next descent is to begin, in units of what counts
    snapped, tied  since the last load
    supplied       since the last load: ∫ ∂Π/∂u · du, and what terms with a memory and descents took [J]
    """

    load: Int[AnyArray, ""]
    steps: Int[AnyArray, ""]
    snaps: Int[AnyArray, ""]
    phase: Int[AnyArray, ""]
    tries: Int[AnyArray, ""]
    origin: Float[AnyArray, " channels"]
    anchor: Anchor
    beyond: Beyond
    descent: Descent
    q: Float[AnyArray, " dofs"]
    t: Float[AnyArray, ""]
    s: Float[AnyArray, ""]
    growth: Float[AnyArray, ""]
    previous: tuple[Float[AnyArray, " dofs"], Float[AnyArray, ""]]
    memories: Memories
    snap: Bool[AnyArray, ""]
    nudge: Float[AnyArray, ""]
    snapped: Bool[AnyArray, ""]
    tied: Bool[AnyArray, ""]
    supplied: Float[AnyArray, ""]
    dissipated: Float[AnyArray, ""]


def begin(
    q: Float[AnyArray, " dofs"],
    origin: Float[AnyArray, " channels"],
    memories: Memories,
) -> ContinuationState:
    """A robot at pose q and loads `origin`."""
    n, channels = len(q), len(origin)
    zeros: Any = np.zeros
    whole, flag, one = zeros((), int), zeros((), bool), zeros(())
    coupling = zeros((n, n)) if memories else None
    nothing = Evaluation(one, zeros(n), zeros((n, n)), zeros(channels), zeros((channels, n)), coupling)
    memories = tuple(zeros(np.shape(memory)) + memory for memory in memories)
    q = zeros(n) + q
    return ContinuationState(
        load=whole,
        steps=whole,
        snaps=whole,
        phase=whole + DESCEND,
        tries=whole,
        origin=zeros(channels) + origin,
        anchor=Anchor(
            q, one, zeros(n), zeros(n), zeros(n), one, memories, one, zeros(channels), zeros(channels)
        ),
        beyond=Beyond(flag, zeros(n), one, zeros(n), one, whole),
        descent=Descent(
            q, nothing, one + np.inf, zeros(n), one, one, one, one + np.inf, one, ~flag, one + UPHILL, ~flag
        ),
        q=q,
        t=one,
        s=one,
        growth=one + 2,
        previous=(zeros(n), one + np.inf),
        memories=memories,
        snap=flag,
        nudge=one + 1,
        snapped=flag,
        tied=flag,
        supplied=one,
        dissipated=one,
    )
