"""What vector environments have in common."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from jaxtyping import Bool

from exosight.errors import InputError


def reseed(
    generators: list[np.random.Generator],
    seed: int | Sequence[int | None] | None,
    which: Bool[np.ndarray, " environments"],
) -> None:
    """Begin the generators of some environments anew: from a seed and the following ones, or from one each.

    Raises InputError for another number of seeds.
    """
    count = len(generators)
    seeds = seed if isinstance(seed, Sequence) else [None if seed is None else seed + i for i in range(count)]
    if len(seeds) != count:
        raise InputError(f"seed: expected one, or {count}, got {len(seeds)}")
    for i, own in enumerate(seeds):
        if own is not None and which[i]:
            generators[i] = seeding.np_random(own)[0]


def row(seen: Any, i: int) -> Any:
    """One grip's observation."""
    return {name: part[i] for name, part in seen.items()} if isinstance(seen, dict) else seen[i]
