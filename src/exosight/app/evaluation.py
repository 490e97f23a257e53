"""A network judged on a dataset: its scores beside the paper's, as tables, figures and files."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int, Int8, Int32, UInt8

from exosight.app.console import progress, to_json
from exosight.app.pipeline import Data, divided, inputs, stacked_rows, test_part
from exosight.app.report import Picture, Report, Section, write_report, write_tables
from exosight.control.estimator import OnnxEstimator, Reading
from exosight.evaluation import (
    Cell,
    Column,
    Coverage,
    OodDetection,
    Scores,
    Table,
    calibration_table,
    contact_table,
    detail_table,
    evaluate_baselines,
    evaluate_details,
    evaluate_intervals,
    evaluate_ood_detection,
    figures,
    interval_table,
    largest_table,
    mean_table,
    ood_detection_table,
    robustness_table,
    score,
)
from exosight.evaluation.robustness import CLEAN
from exosight.files import as_csv, write_new_file
from exosight.learning.intervals import LEVELS
from exosight.vision.corruptions import CORRUPTIONS, corrupt

Images = UInt8[np.ndarray, "frames height width"]
Read = Callable[[Images, Sequence[float]], dict[float, Reading]]

USUAL = 0.9
"""Share of true forces that the intervals shown for degraded images promise to hold."""


@dataclass(frozen=True)
class Evaluation:
    """What a network answers on the frames that it may be judged on."""

    frames: str
    """Which frames these are, in words."""
    true: Float32[np.ndarray, "frames 7"]
    """f_C1…f_C7 [N]."""
    loading: Int8[np.ndarray, " frames"]
    """+1 while the actuation rises, −1 while it falls."""
    shape_id: Int32[np.ndarray, " frames"]
    """Number of the exosuit."""
    readings: dict[str, Reading]
    """"clean" and each corruption of the images → what is read off them, with intervals of USUAL."""
    intervals: Coverage
    """Of the clean images, at every level."""
    ood: tuple[OodDetection, ...]
    """Held-out changes and pictures of other things."""
    baselines: dict[str, Scores]
    """What can be told of the same frames without a picture; empty for another dataset."""

    @property
    def estimated(self) -> Float32[np.ndarray, "frames 7"]:
        """Forces read off the clean images [N]."""
        return self.readings[CLEAN].forces

    @property
    def cases(self) -> dict[str, Scores]:
        """ "clean" and each corruption → scores."""
        return {name: score(self.true, reading.forces) for name, reading in self.readings.items()}

    @property
    def accuracy(self) -> tuple[Table, ...]:
        """Each contact, largest forces, more on the errors, what no picture is needed for."""
        scores = score(self.true, self.estimated)
        contact = self.readings[CLEAN].contact
        details = evaluate_details(self.true, self.estimated, contact, self.loading, self.shape_id)
        tables = (
            contact_table("contacts", "Each contact", scores),
            largest_table("largest_forces", "Largest forces", scores),
            detail_table("details", "More on the errors", details),
        )
        if not self.baselines:
            return tables
        cases = {"this network": scores, **self.baselines}
        note = "The baselines see no picture; the last two know u and whether it rises or falls."
        return (*tables, mean_table("baselines", "Mean ± SD over C1…C7", cases, "estimator", note))

    @property
    def trust(self) -> tuple[Table, ...]:
        """Degraded images, intervals, unlike images."""
        return (
            robustness_table("robustness", "Mean ± SD over C1…C7 on degraded images", self.cases),
            self._shifts(),
            interval_table("intervals", "Intervals, clean images", self.intervals),
            calibration_table("calibration", "Calibration error of the intervals", self.intervals),
            ood_detection_table("ood", "Images unlike those learned from", self.ood),
        )

    @property
    def tables(self) -> tuple[Table, ...]:
        """All of them."""
        return (*self.accuracy, *self.trust)

    def _shifts(self) -> Table:
        """Whether intervals hold on degraded images, and how many of these are trusted."""
        columns = (
            Column("images"),
            Column("mean", "%", "inside", 1),
            Column("lowest contact", "%", "inside", 1),
            Column("flagged as OOD", "%", digits=1),
        )
        rows: list[tuple[Cell, ...]] = []
        for name, reading in self.readings.items():
            ends = {USUAL: (reading.low, reading.high)}
            inside = 100 * evaluate_intervals(self.true, reading.forces, ends).at(USUAL)
            flagged = 100 * float(np.mean(reading.ood_score > 1))
            rows.append((name.replace("-", ", "), float(inside.mean()), float(inside.min()), flagged))
        note = f"Intervals that promise {100 * USUAL:g} % on clean images, over C1…C7."
        return Table("shifts", "Intervals and trust on degraded images", columns, tuple(rows), note)


def evaluate(estimator: OnnxEstimator, data: Data, seed: int) -> Evaluation:
    """Judge a network on a dataset, clean, degraded and unlike, with a progress bar.

    seed   of the noise, and of what is unlike
    """

    card, frames = estimator.card, data.frames
    index, meaning = test_part(card, data)
    rows = stacked_rows(frames, card.history)[index]
    # A network that sees earlier images may see some beyond those that it is judged on.
    seen = np.concatenate([index, np.setdiff1d(rows, index)])
    place = np.empty(len(frames), np.intp)
    place[seen] = np.arange(len(seen))
    pictures, true = frames.images[seen], frames.forces[index]
    images = pictures[: len(index)]

    def look(pictures: Images, levels: Sequence[float]) -> dict[float, Reading]:
        own = inputs(pictures, place[rows], frames.u[index], card)
        return estimator.read_levels(pictures[: len(index)], levels, own)

    def ood(others: Images, where: Int[np.ndarray, " frames"]) -> Float32[np.ndarray, " frames"]:
        own = inputs(pictures, place[rows[where]], frames.u[index[where]], card)
        return estimator.read(others, inputs=own).ood_score

    with _counted(look, (1 + len(CORRUPTIONS)) * len(seen)) as read:
        clean = read(pictures, LEVELS)
        usual = clean[USUAL]
        ends = {level: (reading.low, reading.high) for level, reading in clean.items()}
        degraded = {name: read(corrupt(pictures, name, seed), (USUAL,))[USUAL] for name in CORRUPTIONS}
        return Evaluation(
            frames=f"{len(index)} frames: {meaning}",
            true=true,
            loading=frames.loading[index],
            shape_id=frames.shape_id[index],
            readings={CLEAN: usual, **degraded},
            intervals=evaluate_intervals(true, usual.forces, ends),
            ood=evaluate_ood_detection(ood, images, usual.ood_score, seed),
            baselines=_baselines(estimator, data) if len(index) < len(frames) else {},
        )


def write_evaluation(found: Evaluation, about: dict[str, str | int], estimator: OnnxEstimator, folder: Path):
    """Write tables (CSV, JSON), page of figures, estimates (CSV) and configuration into a folder.

    about   what was judged on what: model, data and seed
    """
    true, estimated = found.true, found.estimated
    pictures = (
        (figures.sample_traces(true, estimated), "True and estimated force of random frames."),
        (figures.predicted_against_true(true, estimated), "Estimated over true force."),
        (figures.rainclouds(true, estimated), "Distribution of true and estimated forces."),
        (figures.robustness_bars(found.cases), "Errors on degraded images beside the paper's."),
        (
            figures.reliability(found.intervals),
            "Share of true forces inside the intervals over that promised.",
        ),
    )
    report = Report(
        title="Evaluation of a force estimator",
        summary=f"{about['model']} on {about['data']}, {found.frames}.",
        sections=(
            Section("Accuracy", found.accuracy),
            Section("Trust", found.trust),
            Section("Figures", tuple(Picture(figure, caption, caption) for figure, caption in pictures)),
        ),
        footer=f"exosight {estimator.card.exosight_version}; noise seed {about['seed']}",
    )
    write_tables(report, folder)
    write_report(report, folder / "evaluation.html")
    config = to_json({**about, "frames": found.frames, "card": asdict(estimator.card)})
    write_new_file(folder / "config.json", config.encode())
    write_new_file(folder / "forces.csv", _to_csv(true, estimated).encode())


def _baselines(estimator: OnnxEstimator, data: Data) -> dict[str, Scores]:
    """On the split that the network learned from, which its card names."""
    told = estimator.card.data
    split = divided(data, str(told["protocol"]), int(told["split_seed"]), str(told["held_out"]) or None)
    return evaluate_baselines(data.frames, split, data.manifest)


@contextmanager
def _counted(read: Read, total: int) -> Iterator[Read]:
    """The estimator with a bar that counts images."""
    done = 0
    with progress("judging", "images") as update:

        def counted(images: Images, levels: Sequence[float]) -> dict[float, Reading]:
            nonlocal done
            answer = read(images, levels)
            done += len(images)
            update(done, total)
            return answer

        yield counted


def _to_csv(true: Float32[np.ndarray, "frames 7"], estimated: Float32[np.ndarray, "frames 7"]) -> str:
    heads = [f"C{i} {kind} [N]" for kind in ("true", "estimated") for i in range(1, 8)]
    return as_csv(heads, np.hstack([true, estimated]).tolist())
