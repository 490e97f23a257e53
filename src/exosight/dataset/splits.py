"""Dividing frames into training, validation and test parts, by four protocols.

frame      60/20/20 % of the frames at random: the published protocol. Near-identical frames of one design
           fall on both sides, so it measures interpolation along known paths.
design     60/20/20 % of the designs, every scenario divided as evenly as possible: known kinds.
family     the test part is every frame of one family; the other designs are divided 75/25 %: unseen kinds.
variation  the test part is the fifth of the frames in which one thing that varies in the dataset is largest,
           such as a modulus or the turn of the camera; the designs of the others are divided 75/25 %:
           unseen stiffness, unseen cameras.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int, Int32

from exosight.dataset.frames import Columns, Frames
from exosight.errors import InputError

PROTOCOLS = ("frame", "design", "family", "variation")

Index = Int[np.ndarray, " _"]

_HELD_OUT = 0.2
"""Share of the frames that `variation` keeps for testing."""


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
    """What is kept for testing: a family by `family`, the largest values of what varies by `variation`."""
    edge: float | None = None
    """By `variation`, the smallest value kept for testing."""


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


def split_by_design(frames: Frames, seed: int) -> Split:
    """60/20/20 % of the designs, every scenario divided as evenly as possible.

    Raises InputError for fewer than five designs.
    """
    parts = _divide_designs(frames.design, frames.scenario, (0.6, 0.2, 0.2), seed)
    train, validation, test = (_frames_of(frames.design, part) for part in parts)
    return Split(train, validation, test, protocol="design", seed=seed)


def split_by_family(frames: Frames, seed: int, held_out: str, families: Sequence[str]) -> Split:
    """Test on every frame of one family; divide the other designs 75/25 % into training and validation.

    families   those of the dataset, in the order of its manifest

    Raises InputError for an unknown family, one without frames, or fewer than four other designs.
    """
    if held_out not in families:
        raise InputError(f"held-out family: expected one of {', '.join(families)}, got {held_out!r}")
    out = frames.family == families.index(held_out)
    if not out.any():
        raise InputError(f"held-out family: the dataset has no frames of {held_out!r}; choose another family")
    return Split(*_around(frames, out, seed), protocol="family", seed=seed, held_out=held_out)


def split_by_variation(frames: Frames, seed: int, held_out: str, variation: Columns) -> Split:
    """Test on the fifth of the frames in which something is largest; divide the others' designs 75/25 %.

    held_out   its name, such as `plant.young` or `appearance.roll`
    variation  what was drawn for each frame

    Raises InputError for what does not vary in the dataset, hardly does, or leaves fewer than four designs.
    """
    if held_out not in _varying(variation):
        raise InputError(
            f"held-out variation: expected what varies in the dataset ({_listed(_varying(variation))}), got "
            f"{held_out!r}; generate a dataset in which it varies"
        )
    values = variation[held_out]
    edge = float(np.quantile(values, 1 - _HELD_OUT, method="higher"))
    out = values >= edge
    if out.mean() > 2 * _HELD_OUT:
        raise InputError(
            f"held-out variation: {held_out} has its largest value, {edge:g}, in {out.mean():.0%} of the "
            "frames, which leaves too few to learn from; choose another"
        )
    parts = _around(frames, out, seed)
    return Split(*parts, protocol="variation", seed=seed, held_out=held_out, edge=edge)


def make_split(
    frames: Frames,
    protocol: str,
    seed: int,
    held_out: str | None = None,
    variation: Columns | None = None,
    families: Sequence[str] = (),
) -> Split:
    """Divide frames by one of PROTOCOLS.

    held_out   what `family` or `variation` keeps for testing
    variation  what was drawn for each frame, for `variation`, as `read_variation` gives it
    families   the manifest's, for `family`

    Raises InputError for an unknown protocol, a missing or needless held_out, or too little to divide.
    """
    if protocol not in PROTOCOLS:
        raise InputError(f"split: expected one of {', '.join(PROTOCOLS)}, got {protocol!r}")
    variation = variation or {}
    if protocol in ("frame", "design"):
        if held_out is not None:
            raise InputError(f"split by {protocol}: holds nothing out, got {held_out!r}")
        return split_by_frame(frames, seed) if protocol == "frame" else split_by_design(frames, seed)
    if held_out is None:
        known = _listed(families if protocol == "family" else _varying(variation))
        raise InputError(f"split by {protocol}: name what is held out ({known})")
    if protocol == "family":
        return split_by_family(frames, seed, held_out, families)
    return split_by_variation(frames, seed, held_out, variation)


def _varying(variation: Columns) -> list[str]:
    return [name for name, values in variation.items() if (values != values[:1]).any()]


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names) or "nothing does"


def _around(frames: Frames, out: Bool[np.ndarray, " frames"], seed: int) -> tuple[Index, Index, Index]:
    """Training, validation and test part: the last is what is held out, the others divide the rest."""
    parts = _divide_designs(frames.design[~out], frames.scenario[~out], (0.75, 0.25), seed)
    train, validation = (np.flatnonzero(np.isin(frames.design, part) & ~out) for part in parts)
    return train, validation, np.flatnonzero(out)


def _divide_designs(
    design: Int32[np.ndarray, " frames"],
    scenario: Int[np.ndarray, " frames"],
    shares: Sequence[float],
    seed: int,
) -> list[Index]:
    """Design numbers of each part.

    Designs are lined up scenario by scenario, shuffled within each, and dealt to the part that lags most
    behind its share: any stretch of the line, so any scenario, is divided evenly.
    """
    designs, first = np.unique(design, return_index=True)
    needed = round(1 / min(shares))
    if len(designs) < needed:
        raise InputError(
            f"split: expected at least {needed} designs to divide, got {len(designs)}; generate more designs"
        )
    rng = np.random.default_rng(seed)
    groups = [designs[scenario[first] == each] for each in rng.permutation(np.unique(scenario[first]))]
    line = np.concatenate([rng.permutation(group) for group in groups])
    counts = np.zeros(len(shares))
    dealt = np.empty(len(line), dtype=np.intp)
    for place in range(len(line)):
        # Rounded, so that equal lags tie whatever the round-off; a tie goes to the first part.
        dealt[place] = np.argmax(np.round(np.array(shares) * (place + 1) - counts, 9))
        counts[dealt[place]] += 1
    return [line[dealt == part] for part in range(len(shares))]


def _frames_of(design: Int32[np.ndarray, " frames"], designs: Index) -> Index:
    return np.flatnonzero(np.isin(design, designs))
