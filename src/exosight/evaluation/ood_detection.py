"""Out-of-distribution detection: how well the OOD score separates other images from clean test images."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

from exosight.errors import InputError
from exosight.evaluation.tables import Cell, Column, Table
from exosight.vision import HELD_OUT, OOD_KINDS, augment, draw_appearance, draw_ood_images
from exosight.vision.disturbances import is_clean

Images = UInt8[np.ndarray, "frames height width"]
Scores = Float[np.ndarray, " frames"]
Places = Int[np.ndarray, " frames"]

MANY = 500
"""Most images of each kind: an AUROC of 0.97 is then known to 0.01."""


@dataclass(frozen=True)
class OodDetection:
    """One kind of out-of-distribution images."""

    kind: str
    frames: int
    auroc: float
    """probability that such an image has a higher score than a clean one of the test part [-]"""
    flagged: float
    """share of them above the limit [-]"""


def auroc(usual: Float[np.ndarray, " usual"], ood: Float[np.ndarray, " ood"]) -> float:
    """Probability that an out-of-distribution image scores higher than a clean one, ties counting half [-].

    It is the area under the receiver operating characteristic, and Mann and Whitney's U over both numbers.

    Raises InputError if there are none of one, or a score is not finite.
    """
    if not (len(usual) and len(ood) and np.isfinite(usual).all() and np.isfinite(ood).all()):
        raise InputError(
            f"scores: expected finite numbers of at least one image each, got {len(usual)} and {len(ood)}"
        )
    ordered = np.sort(usual)
    below, not_above = (np.searchsorted(ordered, ood, side=side) for side in ("left", "right"))
    return float(np.mean(below + not_above) / 2 / len(usual))


def evaluate_ood_detection(
    ood: Callable[[Images, Places], Scores], images: Images, usual: Scores, seed: int
) -> tuple[OodDetection, ...]:
    """Evaluate the score on held-out backgrounds and occlusions, and on images of other things.

    ood      images, and the frames of the test part that each replaces → OOD scores; the limit is 1
    images   of the test part; held-out cases are made from those before the renderer's background, and are
             left out if none is
    usual    the scores of these
    seed     of what is drawn
    """
    _, height, width = images.shape
    count = min(MANY, len(images))
    clean = np.flatnonzero(is_clean(images))
    picked = np.random.default_rng(seed).permutation(clean)[:count]
    cases: dict[str, tuple[Callable[[], Images], Places]] = {
        f"held-out {name}": (
            lambda v=variation: augment(images[picked], draw_appearance(v, seed, picked)),
            picked,
        )
        for name, variation in (HELD_OUT.items() if len(picked) else ())
    }
    cases |= {
        kind: (lambda k=kind: draw_ood_images(k, count, seed, width, height), np.arange(count))
        for kind in OOD_KINDS
    }
    found = {kind: ood(make(), places) for kind, (make, places) in cases.items()}
    return tuple(
        OodDetection(kind, len(scores), auroc(usual, scores), float(np.mean(scores > 1)))
        for kind, scores in found.items()
    )


def ood_detection_table(name: str, caption: str, found: tuple[OodDetection, ...]) -> Table:
    """Return AUROC and share flagged, a row a kind."""
    columns = (
        Column("images"),
        Column("frames"),
        Column("AUROC", digits=3),
        Column("flagged", "%", digits=1),
    )
    rows: tuple[tuple[Cell, ...], ...] = tuple((f.kind, f.frames, f.auroc, 100 * f.flagged) for f in found)
    note = (
        "AUROC: probability that such an image scores higher than a clean one of the same test frames. "
        "Flagged: above the limit."
    )
    return Table(name, caption, columns, rows, note)
