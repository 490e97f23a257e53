"""Dividing frames into training, validation and test parts, by four protocols.

frame      60/20/20 % of the frames at random: the published protocol. Near-identical frames of one design
           fall on both sides, so it measures interpolation along known paths.
design     60/20/20 % of the designs, every scenario divided as evenly as possible: known kinds.
family     the test part is every frame of one family; the other designs are divided 75/25 %: unseen kinds.
variation  the test part is the fifth of the frames in which one thing that varies in the dataset is largest,
           such as a modulus or the turn of the camera; the designs of the others are divided 75/25 %:
           unseen stiffness, unseen cameras.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int, Int32

from exosight.dataset.frames import Columns, Frames
from exosight.errors import InputError
from exosight.validation import check_name

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


def make_split(
    frames: Frames,
    protocol: str,
    seed: int,
    held_out: str | None = None,
    variation: Columns | None = None,
    families: Sequence[str] = (),
) -> Split:
    """Divide frames by one of PROTOCOLS.

    held_out   by `family`, the name of the family that is kept for testing; by `variation`, of what varies,
               such as `plant.young` or `appearance.roll`
    variation  what was drawn for each frame, for `variation`, as `read_variation` gives it
    families   the manifest's, for `family`

    Raises InputError for an unknown protocol, a missing or needless held_out, or too little to divide.
    """
    check_name("split", protocol, PROTOCOLS)
    if protocol in ("frame", "design"):
        if held_out is not None:
            raise InputError(f"split by {protocol}: holds nothing out, got {held_out!r}")
        parts = _by_frame(len(frames), seed) if protocol == "frame" else _by_design(frames, seed)
        return Split(*parts, protocol=protocol, seed=seed)
    varying = [name for name, values in (variation or {}).items() if (values != values[:1]).any()]
    known = list(families) if protocol == "family" else varying
    if held_out is None:
        raise InputError(
            f"split by {protocol}: name what is held out ({', '.join(known) or 'nothing varies'})"
        )
    check_name(f"held-out {protocol}", held_out, known)
    edge = None
    if protocol == "family":
        out = frames.family == known.index(held_out)
    else:
        values = (variation or {})[held_out]
        edge = float(np.quantile(values, 1 - _HELD_OUT, method="higher"))
        out = values >= edge
    if not 0 < out.mean() <= (1 if edge is None else 2 * _HELD_OUT):
        raise InputError(
            f"held-out {protocol}: {out.mean():.0%} of the frames have {held_out}"
            f"{'' if edge is None else f' at its largest value, {edge:g}'}; choose another"
        )
    parts = _by_design(frames, seed, out)
    return Split(*parts, protocol=protocol, seed=seed, held_out=held_out, edge=edge)


def _by_frame(total: int, seed: int) -> list[Index]:
    if total < 5:
        raise InputError(
            f"split by frame: expected at least 5 frames, got {total}; generate a larger dataset"
        )
    order = np.random.default_rng(seed).permutation(total)
    train, validation = round(0.6 * total), round(0.2 * total)
    return [np.sort(part) for part in np.split(order, [train, train + validation])]


def _by_design(frames: Frames, seed: int, test: Bool[np.ndarray, " frames"] | None = None) -> list[Index]:
    """60/20/20 % of the designs, or 75/25 % of those of the frames that are not for testing."""
    out = np.zeros(len(frames), bool) if test is None else test
    shares = (0.6, 0.2, 0.2) if test is None else (0.75, 0.25)
    groups = _divide_designs(frames.design[~out], frames.scenario[~out], shares, seed)
    parts = [np.flatnonzero(np.isin(frames.design, group) & ~out) for group in groups]
    return parts if test is None else [*parts, np.flatnonzero(out)]


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
            f"split: expected at least {needed} designs to divide, got {len(designs)}; generate more, or "
            "import more sequences"
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
