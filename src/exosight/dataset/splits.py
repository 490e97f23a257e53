"""Dividing frames into training, validation and test parts, by three protocols.

frame   60/20/20 % of the frames at random: the published protocol. Near-identical frames of one shape fall on
        both sides, so it measures interpolation along known paths.
shape   60/20/20 % of the shapes, every scenario divided as evenly as possible: unseen shapes, known kinds.
family  the test part is every frame of one family; the other shapes are divided 75/25 %: unseen kinds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int, Int32

from exosight.dataset.frames import Frames
from exosight.errors import InputError
from exosight.exosuit.shapes import FAMILIES

PROTOCOLS = ("frame", "shape", "family")

Index = Int[np.ndarray, " _"]


@dataclass(frozen=True)
class Split:
    """Which frames go where: places in the dataset, ascending, each frame in one part."""

    train: Index
    validation: Index
    test: Index
    protocol: str
    """One of PROTOCOLS."""
    seed: int
    held_out: str | None = None
    """The family kept for testing, for the protocol `family`."""


def split_by_frame(frames: Frames, seed: int) -> Split:
    """60/20/20 % of the frames at random.

    Raises InputError for fewer than five frames.
    """
    total = len(frames)
    if total < 5:
        raise InputError(
            f"split by frame: expected at least 5 frames, got {total}; generate a larger dataset"
        )
    order = np.random.default_rng(seed).permutation(total)
    train, validation = round(0.6 * total), round(0.2 * total)
    parts = np.split(order, [train, train + validation])
    return Split(*(np.sort(part) for part in parts), protocol="frame", seed=seed)


def split_by_shape(frames: Frames, seed: int) -> Split:
    """60/20/20 % of the shapes, every scenario divided as evenly as possible.

    Raises InputError for fewer than five shapes.
    """
    parts = _divide_shapes(frames.shape_id, frames.scenario, (0.6, 0.2, 0.2), seed)
    train, validation, test = (_frames_of(frames.shape_id, part) for part in parts)
    return Split(train, validation, test, protocol="shape", seed=seed)


def split_by_family(frames: Frames, seed: int, held_out: str) -> Split:
    """Test on every frame of one family; divide the other shapes 75/25 % into training and validation.

    Raises InputError for an unknown family, one without frames, or fewer than four other shapes.
    """
    if held_out not in FAMILIES:
        raise InputError(f"held-out family: expected one of {', '.join(FAMILIES)}, got {held_out!r}")
    family = list(FAMILIES).index(held_out)
    out = frames.family == family
    if not out.any():
        raise InputError(f"held-out family: the dataset has no frames of {held_out!r}; choose another family")
    parts = _divide_shapes(frames.shape_id[~out], frames.scenario[~out], (0.75, 0.25), seed)
    train, validation = (_frames_of(frames.shape_id, part) for part in parts)
    return Split(train, validation, np.flatnonzero(out), protocol="family", seed=seed, held_out=held_out)


def make_split(frames: Frames, protocol: str, seed: int, held_out: str | None = None) -> Split:
    """Divide frames by one of PROTOCOLS; `held_out` names the family that `family` keeps for testing.

    Raises InputError for an unknown protocol, a missing or needless held-out family, or too little to divide.
    """
    if protocol not in PROTOCOLS:
        raise InputError(f"split: expected one of {', '.join(PROTOCOLS)}, got {protocol!r}")
    if protocol == "family":
        if held_out is None:
            raise InputError(f"split by family: name the held-out family, one of {', '.join(FAMILIES)}")
        return split_by_family(frames, seed, held_out)
    if held_out is not None:
        raise InputError(f"split by {protocol}: takes no held-out family, got {held_out!r}")
    return split_by_frame(frames, seed) if protocol == "frame" else split_by_shape(frames, seed)


def _divide_shapes(
    shape_id: Int32[np.ndarray, " frames"],
    scenario: Int[np.ndarray, " frames"],
    shares: Sequence[float],
    seed: int,
) -> list[Index]:
    """Shape numbers of each part.

    Shapes are lined up scenario by scenario, shuffled within each, and dealt to the part that lags most
    behind its share: any stretch of the line, so any scenario, is divided evenly.
    """
    shapes, first = np.unique(shape_id, return_index=True)
    needed = round(1 / min(shares))
    if len(shapes) < needed:
        raise InputError(
            f"split: expected at least {needed} shapes to divide, got {len(shapes)}; generate more shapes"
        )
    rng = np.random.default_rng(seed)
    groups = [shapes[scenario[first] == each] for each in rng.permutation(np.unique(scenario[first]))]
    line = np.concatenate([rng.permutation(group) for group in groups])
    counts = np.zeros(len(shares))
    dealt = np.empty(len(line), dtype=np.intp)
    for place in range(len(line)):
        # Rounded, so that equal lags tie whatever the round-off; a tie goes to the first part.
        dealt[place] = np.argmax(np.round(np.array(shares) * (place + 1) - counts, 9))
        counts[dealt[place]] += 1
    return [line[dealt == part] for part in range(len(shares))]


def _frames_of(shape_id: Int32[np.ndarray, " frames"], shapes: Index) -> Index:
    return np.flatnonzero(np.isin(shape_id, shapes))
