"""A network evaluated on a dataset: its scores as tables, figures and files."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int, Int8, Int32, UInt8

from exosight.app.console import progress, to_json
from exosight.app.data import Data
from exosight.app.pipeline import inputs, stacked_rows
from exosight.app.provenance import own_split, test_part
from exosight.app.report import Picture, Report, Section, write_report, write_tables
from exosight.control.estimator import OnnxEstimator, Reading
from exosight.dataset import direction
from exosight.evaluation import (
    Cell,
    Column,
    Coverage,
    OodDetection,
    Scores,
    Table,
    calibration_table,
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
    sensor_table,
)
from exosight.evaluation.large_errors import large_error_table
from exosight.evaluation.naming import forces_only, kind, span
from exosight.evaluation.robustness import CLEAN
from exosight.files import as_csv, write_new_file
from exosight.learning.intervals import LEVELS
from exosight.learning.large_error import LIKELY, LargeError, is_large
from exosight.system.schema import Schema, schema_to_dict
from exosight.vision.corruptions import CORRUPTIONS, corrupt

Images = UInt8[np.ndarray, "frames height width"]
Read = Callable[[Images, Sequence[float]], dict[float, Reading]]

USUAL = 0.9
"""Share of true values that the intervals shown for degraded images promise to hold."""


@dataclass(frozen=True)
class Evaluation:
    """Estimates and scores of a network on the frames that it may be tested on."""

    schema: Schema
    """Of the system whose sensors are estimated."""
    frames: str
    """Which frames these are, in words."""
    true: Float32[np.ndarray, "frames outputs"]
    """What the estimated sensors read [their units]."""
    direction: Int8[np.ndarray, " frames"]
    """+1 while the command rises, −1 while it falls, 0 where there are several channels."""
    design: Int32[np.ndarray, " frames"]
    """Number of the design."""
    readings: dict[str, Reading]
    """"clean" and each corruption of the images → what is estimated from them, with intervals of USUAL."""
    intervals: Coverage
    """Of the clean images, at every level."""
    ood: tuple[OodDetection, ...]
    """Held-out changes and images of other things."""
    large_error: LargeError | None
    """What the network means by a large error; None if it does not say how probable one is."""
    baselines: dict[str, Scores]
    """What is known of the same frames without an image; empty for another dataset."""

    @property
    def estimated(self) -> Float32[np.ndarray, "frames outputs"]:
        """Sensors estimated from the clean images [their units]."""
        return self.readings[CLEAN].forces

    @property
    def cases(self) -> dict[str, Scores]:
        """ "clean" and each corruption → scores."""
        return {
            name: score(self.schema, self.true, reading.forces) for name, reading in self.readings.items()
        }

    @property
    def accuracy(self) -> tuple[Table, ...]:
        """Each output, largest values, more on the errors, what no image is needed for."""
        scores = score(self.schema, self.true, self.estimated)
        contact = self.readings[CLEAN].contact
        details = evaluate_details(
            self.schema, self.true, self.estimated, contact, self.direction, self.design
        )
        what = "forces" if forces_only(self.schema) else "values"
        tables = (
            sensor_table(f"{kind(self.schema)}s", f"Each {kind(self.schema)}", scores),
            largest_table(f"largest_{what}", f"Largest {what}", scores),
            detail_table("details", "More on the errors", self.schema, details),
        )
        if not self.baselines:
            return tables
        cases = {"this network": scores, **self.baselines}
        note = "The baselines have no image; those with one command also know whether it rises or falls."
        return (*tables, mean_table("baselines", f"Mean ± SD over {self._span}", cases, "estimator", note))

    @property
    def reliability(self) -> tuple[Table, ...]:
        """Degraded images, intervals, out-of-distribution images."""
        return (
            robustness_table("robustness", f"Mean ± SD over {self._span} on degraded images", self.cases),
            self._shifts(),
            interval_table("intervals", "Intervals, clean images", self.intervals),
            calibration_table("calibration", "Calibration error of the intervals", self.intervals),
            ood_detection_table("ood", "Out-of-distribution images", self.ood),
            *self._large_errors(),
        )

    @property
    def tables(self) -> tuple[Table, ...]:
        """All of them."""
        return (*self.accuracy, *self.reliability)

    @property
    def _span(self) -> str:
        return span(self.schema.outputs)

    def _large_errors(self) -> tuple[Table, ...]:
        meant = self.large_error
        if meant is None:
            return ()
        cases = {
            name: (reading.error_probability, is_large(meant, self.schema, reading.forces, self.true))
            for name, reading in self.readings.items()
            if reading.error_probability is not None
        }
        return (large_error_table(meant.describe(self.schema), LIKELY, cases),)

    def _shifts(self) -> Table:
        """Whether intervals hold on degraded images, and how many of these are flagged."""
        columns = (
            Column("images"),
            Column("mean", "%", "inside", 1),
            Column(f"lowest {kind(self.schema)}", "%", "inside", 1),
            Column("flagged as OOD", "%", digits=1),
        )
        rows: list[tuple[Cell, ...]] = []
        for name, reading in self.readings.items():
            ends = {USUAL: (reading.low, reading.high)}
            inside = 100 * evaluate_intervals(self.schema, self.true, reading.forces, ends).at(USUAL)
            flagged = 100 * float(np.mean(reading.ood_score > 1))
            rows.append((name.replace("-", ", "), float(inside.mean()), float(inside.min()), flagged))
        note = f"Intervals that promise {100 * USUAL:g} % on clean images, over {self._span}."
        return Table("shifts", "Intervals and OOD score on degraded images", columns, tuple(rows), note)


def evaluate(estimator: OnnxEstimator, data: Data, seed: int) -> Evaluation:
    """Evaluate a network on a dataset: clean, degraded and out-of-distribution images, with a progress bar.

    seed   of the noise, and of the out-of-distribution images

    Raises InputError if the network is for another system than the dataset.
    """

    card, frames = estimator.card, data.frames
    index, meaning = test_part(card, data)
    rows = stacked_rows(frames, card.history)[index]
    # A network with earlier images as inputs may need some beyond those that it is tested on.
    seen = np.concatenate([index, np.setdiff1d(rows, index)])
    place = np.empty(len(frames), np.intp)
    place[seen] = np.arange(len(seen))
    schema, pictures, true = frames.schema, frames.images[seen], frames.labels[index]
    images = pictures[: len(index)]

    def estimate(pictures: Images, levels: Sequence[float]) -> dict[float, Reading]:
        own = inputs(pictures, place[rows], frames.commands[index], card)
        return estimator.read_levels(pictures[: len(index)], levels, own)

    def ood(others: Images, where: Int[np.ndarray, " frames"]) -> Float32[np.ndarray, " frames"]:
        own = inputs(pictures, place[rows[where]], frames.commands[index[where]], card)
        return estimator.read(others, inputs=own).ood_score

    with _counted(estimate, (1 + len(CORRUPTIONS)) * len(seen)) as read:
        clean = read(pictures, LEVELS)
        usual = clean[USUAL]
        ends = {level: (reading.low, reading.high) for level, reading in clean.items()}
        degraded = {name: read(corrupt(pictures, name, seed), (USUAL,))[USUAL] for name in CORRUPTIONS}
        return Evaluation(
            schema=schema,
            frames=f"{len(index)} frames: {meaning}",
            true=true,
            direction=(direction(frames) * (len(schema.channels) == 1)).astype(np.int8)[index],
            design=frames.design[index],
            readings={CLEAN: usual, **degraded},
            intervals=evaluate_intervals(schema, true, usual.forces, ends),
            ood=evaluate_ood_detection(ood, images, usual.ood_score, seed),
            large_error=card.large_error,
            baselines=_baselines(estimator, data) if len(index) < len(frames) else {},
        )


def write_evaluation(found: Evaluation, about: dict[str, str | int], estimator: OnnxEstimator, folder: Path):
    """Write tables (CSV, JSON), page of figures, estimates (CSV) and configuration into a folder.

    about   model, data and seed
    """
    shown = found.schema, found.true, found.estimated
    pictures = (
        (figures.sample_traces(*shown), "True and estimated values of random frames."),
        (figures.predicted_against_true(*shown), "Estimated over true values."),
        (figures.rainclouds(*shown), "Distribution of true and estimated values."),
        (figures.robustness_bars(found.cases), "Errors on degraded images."),
        (
            figures.reliability(found.intervals),
            "Share of true values inside the intervals over that promised.",
        ),
    )
    report = Report(
        title=f"Evaluation of an estimator of the system {found.schema.system}",
        summary=f"{about['model']} on {about['data']}, {found.frames}.",
        sections=(
            Section("Accuracy", found.accuracy),
            Section("Reliability", found.reliability),
            Section("Figures", tuple(Picture(figure, caption, caption) for figure, caption in pictures)),
        ),
        footer=f"exosight {estimator.card.exosight_version}; noise seed {about['seed']}",
    )
    write_tables(report, folder)
    write_report(report, folder / "evaluation.html")
    config = to_json(
        {
            **about,
            "frames": found.frames,
            "card": {**asdict(estimator.card), "schema": schema_to_dict(estimator.card.schema)},
        }
    )
    write_new_file(folder / "config.json", config.encode())
    write_new_file(folder / "forces.csv", _to_csv(*shown).encode())


def _baselines(estimator: OnnxEstimator, data: Data) -> dict[str, Scores]:
    """On the split that the network was trained on, which its card names."""
    return evaluate_baselines(data.frames, own_split(estimator.card, data), data.manifest)


@contextmanager
def _counted(read: Read, total: int) -> Iterator[Read]:
    """The estimator with a bar that counts images."""
    done = 0
    with progress("evaluating", "images") as update:

        def counted(images: Images, levels: Sequence[float]) -> dict[float, Reading]:
            nonlocal done
            found = read(images, levels)
            done += len(images)
            update(done, total)
            return found

        yield counted


def _to_csv(
    schema: Schema,
    true: Float32[np.ndarray, "frames outputs"],
    estimated: Float32[np.ndarray, "frames outputs"],
) -> str:
    heads = [f"{s.name} {which} [{s.unit}]" for which in ("true", "estimated") for s in schema.estimated]
    return as_csv(heads, np.hstack([true, estimated]).tolist())
