"""Whether an estimate is to be trusted, in words, from what its network says of it."""

from dataclasses import dataclass
from typing import Any

from exosight.control.estimator import Reading, shown_score
from exosight.learning.large_error import LIKELY
from exosight.learning.model_file import ModelCard

CLEAR = 0.5
"""Least share of one cause among all for it to be named."""


@dataclass(frozen=True)
class Trust:
    """One estimate: whether it is flagged, and why."""

    flagged: bool
    reason: str
    """what the number is: the probability of a large error, or of networks without it the OOD score"""
    cause: str | None
    """what is probably unusual about the picture; None if nothing is, or it is not clear what"""

    @property
    def words(self) -> str:
        """All of it in one sentence."""
        start = "do not trust these: " if self.flagged else ""
        return start + self.reason + (f"; unusual: {self.cause}" if self.cause else "")


def trust(card: ModelCard, reading: Reading, frame: int = 0) -> Trust:
    """What a network says of one of the images of a reading."""
    score = reading.ood_score[frame]
    probable, meant = reading.error_probability, card.large_error
    if probable is None or meant is None:
        flagged = bool(score > 1)
        place = "out of distribution" if flagged else "within the training distribution"
        reason = f"the picture is {place} (OOD score {shown_score(score):.3f}, trusted up to 1)"
        return Trust(flagged, reason, None)
    flagged = bool(probable[frame] > LIKELY)
    reason = f"probability {100 * probable[frame]:.0f} % of {meant.describe(card.schema)}"
    return Trust(flagged, reason, _cause(card, reading, frame) if flagged or score > 1 else None)


def as_json(reading: Reading, judged: Trust, frame: int = 0) -> dict[str, Any]:
    """The same as plain values; the OOD score beside them."""
    known = reading.error_probability
    return {
        "error_probability": None if known is None else round(float(known[frame]), 4),
        "ood_score": shown_score(reading.ood_score[frame]),
        "trusted": not judged.flagged,
        "unusual": judged.cause,
    }


def _cause(card: ModelCard, reading: Reading, frame: int) -> str | None:
    if reading.causes is None:
        return None
    causes = reading.causes[frame]
    best = int(causes.argmax())
    return card.causes[best] if causes[best] > CLEAR * causes.sum() else None
