"""Random numbers that belong to a frame: whatever the batch, the order or the machine, they are the same.

A generator of NumPy's takes 20 µs to seed, a tenth of the time that a whole frame may take. So numbers are
counted out by a hash: the k-th of a stream is mix(state + k γ). Source: SplitMix64, Steele, Lea and Flood,
doi 10.1145/2714064.2660195.
"""

from collections.abc import Sequence
from functools import lru_cache
from statistics import NormalDist
from typing import no_type_check

import numpy as np
from jaxtyping import Float32, Float64, Integer

from exosight.errors import InputError
from exosight.vision.compiling import compiled

Seed = int | tuple[int, ...]
"""Whole numbers from 0 on; a tuple such as (seed, epoch) gives every epoch draws of its own."""

STEP = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_LARGEST = 2**63


def uniforms(
    seed: Seed, numbers: Integer[np.ndarray, " frames"], count: int
) -> Float64[np.ndarray, "frames {count}"]:
    """Numbers even in [0, 1): a row for each frame, which depends on the seed and the frame's number alone.

    A row begins alike whatever its length.

    Raises InputError for a negative seed or number.
    """
    parts = (seed,) if isinstance(seed, int) else seed
    if not parts or min(parts) < 0 or max(parts) >= _LARGEST or np.any(numbers < 0):
        raise InputError(
            f"seed and frame numbers: expected whole numbers from 0 to 2⁶³, got seed {seed} and numbers from "
            f"{numbers.min(initial=0)}"
        )
    out = np.empty((len(numbers), count))
    _uniforms(np.array(parts, np.uint64), numbers.astype(np.uint64), out)
    return out


@lru_cache(maxsize=1)
def normal_quantiles() -> Float32[np.ndarray, "65536"]:
    """The standard normal numbers that 16 random bits stand for: (i + ½)/65536 of all lie below the i-th."""
    normal = NormalDist()
    upper = [normal.inv_cdf((i + 0.5) / 65536) for i in range(32768, 65536)]
    return np.array([-value for value in reversed(upper)] + upper, np.float32)


def pick(share: Float64[np.ndarray, " frames"], kinds: Sequence[int]) -> Float64[np.ndarray, " frames"]:
    """One of the kinds for each number even in [0, 1)."""
    return np.asarray(kinds, float)[(share * len(kinds)).astype(int)]


@compiled
@no_type_check
def mix(z):
    """64 bits in which every bit of z has a say."""
    z = (z ^ (z >> np.uint64(30))) * _FIRST
    z = (z ^ (z >> np.uint64(27))) * _SECOND
    return z ^ (z >> np.uint64(31))


@compiled
@no_type_check
def _uniforms(seed, numbers, out):
    start = np.uint64(0)
    for part in seed:
        start = mix(start + part + STEP)
    for row in range(len(numbers)):
        state = mix(start ^ mix(numbers[row] + STEP))
        for k in range(out.shape[1]):
            state += STEP
            out[row, k] = (mix(state) >> np.uint64(11)) * 2.0**-53
