"""The first and the last sections: summary, limits, reproducibility."""

from collections.abc import Mapping, Sequence

from exosight.app.chapters.loop import published_steps, target_of
from exosight.app.report import Listing, Points, Section
from exosight.app.results import LoopResult, NetworkResult, RobustnessSummary, TrainingRun
from exosight.control import Trial
from exosight.evaluation import published
from exosight.evaluation.naming import span
from exosight.evaluation.tables import Cell, Column, Table


def headline(
    runs: Sequence[TrainingRun],
    network_results: Sequence[NetworkResult],
    robustness: RobustnessSummary,
    loops: Sequence[LoopResult],
) -> Section:
    """The main results beside the paper's."""
    group = f"mean over {span(network_results[0].schema.outputs)}"
    columns = (
        Column("network, split"),
        Column("training frames"),
        Column("r", "", group, 2),
        Column("RMS%", "%", group, 2),
        Column("RMSE", "N", group, 3),
        Column("r, noisy", "", group, 2),
        *(
            Column(f"{target_of(trial):.2f}\N{NO-BREAK SPACE}N", "", "steps to settle at")
            for trial in loops[0].constant
        ),
    )
    controlled = {loop.name: loop.constant for loop in loops}
    trained = {run.name: run for run in runs}
    rows: list[tuple[Cell, ...]] = []
    for result in network_results:
        run, scores = trained[result.name], result.scores
        noisy = robustness.cases["noise-medium"].r if result.name == robustness.name else None
        settled = [trial.settling_steps for trial in controlled.get(result.name, ())]
        rows.append(
            (
                *(result.name, run.frames, scores.r, scores.rms_percent, scores.rmse),
                *(noisy, *(settled or [None] * len(loops[0].constant))),
            )
        )
    rows += [
        (loop.name, *[None] * 5, *(trial.settling_steps for trial in loop.constant))
        for loop in loops
        if loop.shipped
    ]
    rows.append(_paper_row(loops[0].constant))
    note = (
        "r: Pearson's correlation of estimated and true force; RMS%: error as a share of the range of the "
        "true force; noisy: test images with noise of variance 0.01; ±: standard deviation over the "
        "contacts. Settling is that of the closed loop, for the networks used in it. A dash means that "
        "there is no such number: not asked for, or not settled."
    )
    return Section(
        "Summary",
        (
            Table("headline", "This study beside the paper", columns, tuple(rows), note),
            "The two systems are similar, not the same: the paper leaves parameters open "
            "that had to be chosen here, and its images were rendered differently. The paper divides its "
            "data frame by frame, so near-identical frames of one exosuit are in both the training "
            "and the test set. Divided by shape, no test exosuit was used in training, which is harder. A "
            "study of fewer shapes than the paper's is also trained and tested on fewer frames.",
        ),
    )


def _paper_row(trials: Sequence[Trial]) -> tuple[Cell, ...]:
    clean, noisy = (published.ROBUSTNESS_PUBLISHED[case] for case in ("clean", "noise-medium"))
    return (
        *("paper, by frame", published.FRAMES_LEARNED),
        *(clean.r, clean.rms_percent, clean.rmse, noisy.r),
        *(published_steps(trial) for trial in trials),
    )


def limits() -> Section:
    """Limits of every study."""
    return Section(
        "Limits",
        (
            Points(
                (
                    "All images are rendered. Real fingers, exosuits and cameras, skin, light, background "
                    "and a moving camera are not in the data.",
                    "Contact has no friction. That of published is between spheres: the finger carries a few "
                    "of them, with gaps between them into which a bent rod can slip, and the true forces are "
                    "those of this model.",
                    "Every pose is an equilibrium. Inertia and the silicone's damping are neglected, so a "
                    "fast controller is easier to stabilise than on a real system.",
                    "There is one finger: its lengths, radii and joint stiffness never change. The "
                    "stiffness of the silicone is one number too, chosen to match the paper's only usable "
                    "data point.",
                    f"The actuation in the training data ends at {published.TRAINING_LIMIT:g} N and never "
                    "pulls. Beyond that, and for shapes outside the five families, an estimate is "
                    "extrapolated.",
                    "The image must show the side view at the scale of the training data. Forces come out "
                    "of any image of the right size, whether or not it shows a finger. The command exosight "
                    "estimate adds intervals, and an OOD score that flags images that differ from the "
                    "training data; the loop above uses neither.",
                )
            ),
        ),
    )


def remake(command: str, config: str, seed: int, versions: Mapping[str, str]) -> Section:
    """How to reproduce this study.

    command   the line that was run
    config    its whole configuration, as the file that was saved beside the report
    versions  package → version
    """
    rows = tuple(versions.items())
    return Section(
        "Reproducibility",
        (
            f"Everything random follows from one seed, {seed}. Other versions of the packages, and other "
            "processors, may round differently, which training amplifies: expect similar results, not the "
            "same digits.",
            Listing("The command.", command),
            Listing("The whole configuration of this study.", config),
            Table("versions", "Versions", (Column("package"), Column("version")), rows),
        ),
    )
