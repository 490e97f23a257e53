"""Sections on the estimator: its training, accuracy and robustness."""

from collections.abc import Sequence

import numpy as np

from exosight.app.report import Block, Picture, Section
from exosight.app.results import NetworkResult, RobustnessSummary, TrainingRun
from exosight.evaluation import figures, published
from exosight.evaluation.naming import kind, span, sums
from exosight.evaluation.tables import (
    Column,
    Table,
    count_text,
    largest_table,
    mean_table,
    robustness_table,
    sensor_table,
)


def learning(runs: Sequence[TrainingRun], outputs: Sequence[str]) -> Section:
    """Show how each network was trained.

    outputs   names of the estimated sensors
    """
    columns = (
        Column("network"),
        Column("parameters"),
        Column("frames"),
        Column("epochs"),
        Column("best epoch"),
        Column("validation error", "N", digits=4),
        Column("time", "min", digits=1),
    )
    rows = tuple(
        (
            *(run.name, run.parameters, run.frames, len(run.history)),
            *(run.best.epoch, run.best.validation_l1, run.minutes),
        )
        for run in runs
    )
    note = (
        f"The paper: {count_text(published.PARAMETERS)} parameters, {published.EPOCHS} epochs, "
        f"{published.TRAINING_MINUTES:g} min on a Titan Xp. The validation error is the mean absolute error "
        f"over {span(outputs)} in the best epoch, whose network is kept."
    )
    blocks: list[Block] = [Table("training", "Training runs", columns, rows, note)]
    for run in runs:
        blocks.append(
            Picture(
                figures.loss_curves(*_curves(run), run.loss),
                f"Loss of the {run.name}: on the training frames and on the validation frames, and the "
                "learning rate. Dotted lines mark where a constant learning rate was lowered.",
                f"Training and validation loss over {len(run.history)} epochs, with the learning rate below.",
            )
        )
    return Section("Training", tuple(blocks))


def accuracy(network_results: Sequence[NetworkResult]) -> Section:
    """Compare estimated with true forces on the test frames; the figures show the first result."""
    first = network_results[0]
    schema, shown = first.schema, (first.schema, first.true, first.estimated)
    outputs, number = span(schema.outputs), len(schema.outputs) + len(sums(schema))
    panels = " and ".join([outputs, *sums(schema)])
    blocks: list[Block] = [
        "All numbers are for test frames, which were not used in training. RMSE is the root mean "
        "square error, RMS% the same over the range of the true force, and r Pearson's correlation.",
    ]
    if len(network_results) > 1:
        means = {result.name: result.scores for result in network_results}
        note = "The paper's values are for its split by frame and stand in every row for comparison."
        blocks.append(mean_table("accuracy", f"Mean ± SD over {outputs}", means, "network, split", note))
    blocks += [
        sensor_table(f"{kind(schema)}s_{place}", f"Each {kind(schema)}: {result.name}", result.scores)
        for place, result in enumerate(network_results, start=1)
    ]
    blocks += [
        largest_table("largest_forces", f"Largest forces: {first.name}", first.scores),
        Picture(
            figures.sample_traces(*shown),
            "True and estimated force for a random set of test frames, a panel a contact; gray lines are "
            f"the errors ({first.name}).",
            f"{number} panels, {panels}, each with true and estimated forces of random frames.",
        ),
        Picture(
            figures.predicted_against_true(*shown),
            f"Estimated over true force for all {count_text(len(first.true))} test frames; a perfect "
            f"estimate lies on the line ({first.name}).",
            f"{number} density plots, {panels}, of estimated over true force with the identity line.",
        ),
        Picture(
            figures.rainclouds(*shown),
            "Distribution of estimated (above) and true (below) forces in the test frames in which the "
            "contact touches, and the share of these among all. Cloud: density; box: quartiles and median; "
            f"points: up to 300 frames ({first.name}).",
            f"{number} raincloud plots, {panels}: estimated distribution above, true below.",
        ),
    ]
    return Section("Accuracy", tuple(blocks))


def robustness_section(robustness: RobustnessSummary) -> Section:
    """Accuracy on images with noise and low contrast."""
    outputs = span(next(iter(robustness.cases.values())).schema.outputs)
    training = (
        "It was also trained on images with random noise and contrast; the paper's was not."
        if robustness.learned
        else "None of this was part of the training."
    )
    return Section(
        "Robustness",
        (
            "The same test frames with noise added or contrast taken away, as in the paper "
            f"({robustness.name}). {training}",
            Picture(
                figures.corrupted_examples(robustness.examples),
                "Test frames, clean and degraded.",
                "A grid of gray images: clean, three levels of noise, two levels of lowered contrast.",
            ),
            robustness_table("robustness", f"Mean ± SD over {outputs} on degraded images", robustness.cases),
            Picture(
                figures.robustness_bars(robustness.cases),
                f"Error and correlation on degraded images beside the paper's, mean ± SD over {outputs}.",
                "Bar charts of RMSE, RMS% and r for six kinds of images, this study beside the paper.",
            ),
        ),
    )


def _curves(run: TrainingRun) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    checked = [record for record in run.history if record.validation_loss is not None]
    return (
        np.array([record.epoch for record in run.history]),
        np.array([record.train_loss for record in run.history]),
        np.array([record.epoch for record in checked], dtype=int),
        np.array([record.validation_loss for record in checked], dtype=float),
        np.array([record.learning_rate for record in run.history]),
    )
