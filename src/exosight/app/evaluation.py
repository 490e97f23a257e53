"""A network judged on a dataset: its scores beside the paper's, as tables, figures and files."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, UInt8

from exosight.app.console import progress, to_json
from exosight.app.pipeline import Data, test_part
from exosight.app.report import Picture, Report, Section, write_report, write_tables
from exosight.control.estimator import OnnxEstimator
from exosight.evaluation import (
    Scores,
    Table,
    contact_table,
    evaluate_robustness,
    figures,
    largest_table,
    robustness_table,
)
from exosight.evaluation.robustness import CLEAN, Estimate
from exosight.files import write_new_file
from exosight.vision.corruptions import CORRUPTIONS


@dataclass(frozen=True)
class Evaluation:
    """What a network answers on the frames that it may be judged on."""

    frames: str
    """Which frames these are, in words."""
    true: Float32[np.ndarray, "frames 7"]
    """f_C1…f_C7 [N]."""
    estimated: Float32[np.ndarray, "frames 7"]
    """[N]"""
    cases: dict[str, Scores]
    """"clean" and each corruption of the images → scores."""

    @property
    def tables(self) -> tuple[Table, ...]:
        """Each contact, largest forces, degraded images."""
        scores = self.cases[CLEAN]
        return (
            contact_table("contacts", "Each contact", scores),
            largest_table("largest_forces", "Largest forces", scores),
            robustness_table("robustness", "Mean ± SD over C1…C7 on degraded images", self.cases),
        )


def evaluate(estimator: OnnxEstimator, data: Data, seed: int) -> Evaluation:
    """Judge a network on a dataset, clean and on degraded images, with a progress bar.

    seed   of the noise
    """
    index, meaning = test_part(estimator.card, data)
    images, true = data.frames.images[index], data.frames.forces[index]
    with _counted(estimator.estimate, len(index)) as estimate:
        cases = evaluate_robustness(estimate, images, true, seed)
        return Evaluation(f"{len(index)} frames: {meaning}", true, estimate(images), cases)


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
    )
    report = Report(
        title="Evaluation of a force estimator",
        summary=f"{about['model']} on {about['data']}, {found.frames}.",
        sections=(
            Section("Scores", found.tables),
            Section("Figures", tuple(Picture(figure, caption, caption) for figure, caption in pictures)),
        ),
        footer=f"exosight {estimator.card.exosight_version}; noise seed {about['seed']}",
    )
    write_tables(report, folder)
    write_report(report, folder / "evaluation.html")
    config = to_json({**about, "frames": found.frames, "card": asdict(estimator.card)})
    write_new_file(folder / "config.json", config.encode())
    write_new_file(folder / "forces.csv", _to_csv(true, estimated).encode())


@contextmanager
def _counted(estimate: Estimate, frames: int) -> Iterator[Estimate]:
    """The estimator with a bar that counts the images of all cases and the clean ones once more."""
    total, done = (len(CORRUPTIONS) + 2) * frames, 0
    with progress("judging", "images") as update:

        def counted(images: UInt8[np.ndarray, "frames height width"]) -> Float32[np.ndarray, "frames 7"]:
            nonlocal done
            answer = estimate(images)
            done += len(images)
            update(done, total)
            return answer

        yield counted


def _to_csv(true: Float32[np.ndarray, "frames 7"], estimated: Float32[np.ndarray, "frames 7"]) -> str:
    heads = [f"C{i} {kind} [N]" for kind in ("true", "estimated") for i in range(1, 8)]
    rows = np.hstack([true, estimated]).tolist()
    return "\n".join([",".join(heads), *(",".join(f"{x:.6g}" for x in row) for row in rows), ""])
