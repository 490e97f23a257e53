"""A network adapted to a dataset, and judged before and after on what it was not shown."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float32, Int

from exosight.app.data import Data
from exosight.app.pipeline import inputs, stacked_rows
from exosight.app.provenance import check_unseen, identity
from exosight.control.estimator import OnnxEstimator, Reading
from exosight.dataset import Split
from exosight.errors import InputError
from exosight.evaluation import Cell, Column, Scores, Table, evaluate_intervals, score
from exosight.evaluation.metrics import finite_or_none
from exosight.learning.model_file import ModelCard
from exosight.system.schema import Schema

if TYPE_CHECKING:
    from exosight.learning.adaptation import Candidate, Labelled, Method  # needs PyTorch

MOST = 2000
"""Labels that are learned from, and further pictures that are looked at: memory grows with their square."""

LEVEL = 0.9
"""Share of true values that the intervals shown promise to hold."""


@dataclass(frozen=True)
class Judged:
    """A network on the test part."""

    scores: Scores
    inside: Float32[np.ndarray, " outputs"]
    """share of true values inside the intervals of LEVEL [-]"""
    flagged: float
    """share of pictures that are out of distribution [-]"""


@dataclass(frozen=True)
class Adapted:
    """What came out, and how it was found."""

    schema: Schema
    labels: int
    pictures: int
    """without labels that were looked at"""
    test: int
    """pictures judged on"""
    before: Judged | None
    """None: the former network estimates other sensors"""
    after: Judged
    chosen: "Candidate"
    candidates: "tuple[Candidate, ...]"

    @property
    def tables(self) -> tuple[Table, ...]:
        """Accuracy before and after, and what was tried."""
        return (self._accuracy(), self._tried()) if self.candidates else (self._accuracy(),)

    @property
    def record(self) -> dict[str, Any]:
        """All of it in plain values."""
        return {
            "labels": self.labels,
            "pictures_without_labels": self.pictures,
            "test_pictures": self.test,
            "method": self.chosen.method,
            "registered": self.chosen.registered,
            "tried": [
                {"method": c.method, "registered": c.registered, "error": c.error} for c in self.candidates
            ],
            "before": None if self.before is None else _plain(self.before),
            "after": _plain(self.after),
        }

    def _accuracy(self) -> Table:
        columns = [Column("sensor")]
        for group in ("r", "RMSE", "inside"):
            unit = {"inside": "%"}.get(group, "")
            digits = {"r": 3, "inside": 0}.get(group)
            columns += [Column(when, unit, group, digits) for when in ("before", "after")]
        rows = []
        for place, output in enumerate(self.after.scores.outputs):
            both = (self.before, self.after)
            found = [None if judged is None else judged.scores.outputs[place] for judged in both]
            rows.append(
                (
                    f"{output.name} [{output.unit}]",
                    *(None if metrics is None else metrics.r for metrics in found),
                    *(None if metrics is None else metrics.rmse for metrics in found),
                    *(None if judged is None else 100 * float(judged.inside[place]) for judged in both),
                )
            )
        shares = [None if judged is None else judged.flagged for judged in (self.before, self.after)]
        flagged = " and ".join("–" if share is None else f"{100 * share:.0f} %" for share in shares)
        note = (
            f"On {self.test} pictures of sequences that were not learned from; inside: true values in the "
            f"intervals that promise {100 * LEVEL:g} %. Flagged as out of distribution before and after: "
            f"{flagged}."
        )
        return Table("adapted", "Before and after", tuple(columns), tuple(rows), note)

    def _tried(self) -> Table:
        columns = Column("what changes"), Column("pictures"), Column("error", digits=3)
        rows: list[tuple[Cell, ...]] = [
            (_WORDS[c.method], "registered" if c.registered else "as they are", c.error)
            for c in self.candidates
        ]
        chosen = "registered" if self.chosen.registered else "as they are"
        note = (
            f"Root mean square error by cross-validation over {self.labels} labels, each sensor in units of "
            f"its scale. Chosen: {_WORDS[self.chosen.method]}, pictures {chosen}."
        )
        return Table("tried", "What was tried", columns, tuple(rows), note)


_WORDS = {
    "none": "nothing",
    "affine": "gain and offset of each output",
    "last": "the last layer",
    "all": "all layers",
}


def adapt(
    data: Data,
    split: Split,
    model: Path,
    labels: int | None,
    method: "Method | str",
    seed: int,
    folder: Path,
    name: str,
    progress: Callable[[int, int], None],
) -> Adapted:
    """Adapt the network in a file, write the result into a folder under a name, and judge both.

    labels   how many pictures of the parts that are not for testing may be learned from with their labels;
             None: all of them, MOST at most

    Raises InputError as `exosight.learning.adaptation.adapt` does, and for more labels than allowed.
    """
    from exosight.learning import load_pretrained
    from exosight.learning.adaptation import adapt as run
    from exosight.learning.export import write_network

    pretrained = load_pretrained(model)
    card, frames = pretrained.card, data.frames
    check_unseen(card, data, split)
    pool = np.concatenate([split.train, split.validation])
    if labels is not None and labels > len(pool):
        raise InputError(
            f"--labels: expected 0 to {len(pool)}, the pictures that are not kept for testing, got {labels}"
        )
    if labels is not None and labels > MOST:
        raise InputError(
            f"--labels: expected up to {MOST}, got {labels}; exosight train --pretrained learns from more"
        )
    chosen = _drawn(frames.design, pool, min(len(pool), MOST) if labels is None else labels, seed)
    others = _drawn(frames.design, np.setdiff1d(pool, chosen), MOST, seed)
    before = None
    if card.schema.image_size == frames.schema.image_size and card.schema.outputs == frames.schema.outputs:
        before = _judged(OnnxEstimator.load(model, threads=2), data, split.test)
    found = run(
        pretrained,
        frames.schema,
        _labelled(data, chosen, card),
        _labelled(data, others, card),
        identity(data, split, start=card),
        method=method,  # pyright: ignore[reportArgumentType]
        seed=seed,
        progress=progress,
    )
    write_network(folder / name, found.model, found.ood, found.card, found.causes)
    return Adapted(
        frames.schema,
        len(chosen),
        len(others),
        len(split.test),
        before,
        _judged(OnnxEstimator.load(folder / name, threads=2), data, split.test),
        found.chosen,
        found.candidates,
    )


def _drawn(
    sequence: Int[np.ndarray, " frames"], pool: Int[np.ndarray, " _"], count: int, seed: int
) -> Int[np.ndarray, " _"]:
    """So many frames of the pool, as evenly from all sequences as there are frames."""
    order = np.random.default_rng(seed).permutation(pool)
    turn = np.empty(len(order), np.intp)  # how many of its own sequence come before each
    for name in np.unique(sequence[order]):
        own = np.flatnonzero(sequence[order] == name)
        turn[own] = np.arange(len(own))
    return np.sort(order[np.argsort(turn, kind="stable")[:count]])


def _labelled(data: Data, rows: Int[np.ndarray, " _"], card: ModelCard) -> "Labelled":
    from exosight.learning.adaptation import Labelled

    frames = data.frames
    stack = stacked_rows(frames, card.history)[rows]
    commands = frames.commands[rows] if card.actuation else None
    return Labelled(frames.images[stack], commands, frames.labels[rows], frames.design[rows])


def _judged(estimator: OnnxEstimator, data: Data, rows: Int[np.ndarray, " _"]) -> Judged:
    frames, card = data.frames, estimator.card
    own = inputs(frames.images, stacked_rows(frames, card.history)[rows], frames.commands[rows], card)
    reading: Reading = estimator.read(frames.images[rows], LEVEL, own)
    true, schema = frames.labels[rows], frames.schema
    coverage = evaluate_intervals(schema, true, reading.forces, {LEVEL: (reading.low, reading.high)})
    return Judged(
        score(schema, true, reading.forces),
        coverage.at(LEVEL).astype(np.float32),
        float(np.mean(reading.ood_score > 1)),
    )


def _plain(judged: Judged) -> dict[str, Any]:
    return {
        "sensors": [
            {
                "name": metrics.name,
                "unit": metrics.unit,
                "r": finite_or_none(metrics.r),
                "rmse": metrics.rmse,
                "inside_90": float(share),
            }
            for metrics, share in zip(judged.scores.outputs, judged.inside, strict=True)
        ],
        "flagged": judged.flagged,
    }
