"""Why episodes fail: the same ones again, with one disturbance removed at a time.

An episode fails if it is attainable and not settled, given up by the guard, or beyond a contact limit.
Several disturbances may be causes together, so the counts do not add up to the number of failures.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from exosight.control.stress.episodes import Episode, joint_springs
from exosight.control.stress.measures import RELEASE_SECONDS, Measured
from exosight.control.valve import AT_ONCE
from exosight.system.system import System

_NOTHING = 1e-9  # share of a modulus that relaxes: a system without creep would be another compiled structure

Removal = Callable[[Episode, System], Episode]
"""An episode without one disturbance; the system is the nominal one."""


def _nominal_plant(episode: Episode, nominal: System) -> Episode:
    springs = joint_springs(nominal)[0]
    return replace(episode, system=nominal, stiffness=episode.stiffness / episode.stiffness[0] * springs)


REMOVALS: Mapping[str, tuple[Callable[[Episode], bool], Removal]] = {
    "frames late": (lambda e: e.latency > 0, lambda e, _: replace(e, latency=0)),
    "frames lost or repeated": (
        lambda e: bool((e.lost | e.again).any()),
        lambda e, _: replace(e, lost=np.zeros_like(e.lost), again=np.zeros_like(e.again)),
    ),
    "noise and occlusion": (lambda e: bool(e.bursts), lambda e, _: replace(e, bursts=())),
    "user moves": (
        lambda e: e.moves,
        lambda e, _: replace(
            e, stiffness=np.broadcast_to(e.stiffness[0], e.stiffness.shape), rest=np.zeros_like(e.rest)
        ),
    ),
    "plant differs": (lambda e: True, _nominal_plant),
    "camera displaced": (lambda e: e.displaced, lambda e, nominal: replace(e, camera=nominal.camera)),
    "friction": (lambda e: bool(e.friction), lambda e, _: replace(e, friction=0.0)),
    "creep": (
        lambda e: e.creep is not None,
        lambda e, _: replace(e, creep=None if e.creep is None else replace(e.creep, share=_NOTHING)),
    ),
    "lag and dead time": (lambda e: e.valve != AT_ONCE, lambda e, _: replace(e, valve=AT_ONCE)),
}
"""By the disturbance: whether an episode has it, and the episode without it."""


def failed(measured: Measured, attainable: bool) -> bool:
    """Whether an episode counts as a failure.

    attainable   its target is constant and the oracle settles at it
    """
    missed = attainable and math.isnan(measured.settling_steps)
    return missed or measured.given_up or measured.seconds_outside > 0


@dataclass(frozen=True)
class Causes:
    """Of the failures that were run again: how many had a disturbance, and how many do not fail without it.

    episodes   numbers of the failures
    counts     (with it, not failing without it) by disturbance
    """

    episodes: tuple[int, ...]
    counts: Mapping[str, tuple[int, int]]


def find_causes(
    episodes: Sequence[Episode],
    measured: Sequence[Measured],
    bound: Sequence[Measured],
    run: Callable[[Sequence[Episode]], Sequence[Measured]],
    nominal: System,
    most: int,
) -> Causes:
    """Run the first failures again, once for each disturbance, without it.

    measured   the episodes of a controller
    bound      those of the oracle
    run        that controller on other episodes
    nominal    the system that it is tuned for
    most       failures that are run again
    """
    attainable = [not math.isnan(best.settling_steps) for best in bound]
    numbers = tuple(i for i, own in enumerate(measured) if failed(own, attainable[i]))[:most]
    counts: dict[str, tuple[int, int]] = {}
    for name, (has, without) in REMOVALS.items():
        having = [has(episodes[i]) for i in numbers]
        if not any(having):
            continue
        # All of them, as many as each time, share their compiled code.
        again = run([without(episodes[i], nominal) for i in numbers])
        succeeds = [
            had and not failed(own, attainable[i]) for i, had, own in zip(numbers, having, again, strict=True)
        ]
        counts[name] = sum(having), sum(succeeds)
    return Causes(numbers, counts)


def worst(measured: Sequence[Measured], count: int) -> list[int]:
    """Numbers of the worst episodes, the worst first: those beyond a contact limit, then those given up or
    released late, then those with the largest tracking error.
    """

    def badness(one: Measured) -> tuple[float, bool, float]:
        late = not one.release_seconds <= RELEASE_SECONDS
        return one.seconds_outside, late or one.given_up, one.tracking_error

    return sorted(range(len(measured)), key=lambda i: badness(measured[i]), reverse=True)[:count]
