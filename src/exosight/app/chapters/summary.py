"""The first and the last sections: the result in short, its limits, and how to make it again."""

from collections.abc import Mapping, Sequence

from exosight.app.chapters.loop import published_steps, target_of
from exosight.app.report import Listing, Points, Section
from exosight.app.results import Judgement, LoopResult, RobustnessSummary, TrainingRun
from exosight.evaluation import published
from exosight.evaluation.naming import span
from exosight.evaluation.tables import Cell, Column, Table


def headline(
    runs: Sequence[TrainingRun],
    judgements: Sequence[Judgement],
    robustness: RobustnessSummary,
    loops: Sequence[LoopResult],
) -> Section:
    """Put the numbers that matter beside the paper's."""
    group = f"mean over {span(judgements[0].schema.outputs)}"
    columns = (
        Column("network, split"),
        Column("frames learned"),
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
    for judgement in judgements:
        run, scores = trained[judgement.name], judgement.scores
        noisy = robustness.cases["noise-medium"].r if judgement.name == robustness.name else None
        settled = [trial.settling_steps for trial in controlled.get(judgement.name, ())]
        rows.append(
            (
                *(judgement.name, run.frames, scores.r, scores.rms_percent, scores.rmse),
                *(noisy, *(settled or [None] * len(loops[0].constant))),
            )
        )
    rows += [
        (loop.name, *[None] * 5, *(trial.settling_steps for trial in loop.constant))
        for loop in loops
        if loop.shipped
    ]
    clean = published.ROBUSTNESS_PUBLISHED["clean"]
    rows.append(
        (
            *("paper, by frame", published.FRAMES_LEARNED),
            *(clean.r, clean.rms_percent, clean.rmse, published.ROBUSTNESS_PUBLISHED["noise-medium"].r),
            *(published_steps(trial) for trial in loops[0].constant),
        )
    )
    note = (
        "r: Pearson's correlation of estimated and true force; RMS%: error as a share of the range of the "
        "true force; noisy: test images with noise of variance 0.01; ±: standard deviation over the "
        "contacts. Settling is that of the closed loop, for the networks that steer it. A dash means that "
        "there is no such number: not asked for, or not settled."
    )
    return Section(
        "The result in short",
        (
            Table("headline", "This study beside the paper", columns, tuple(rows), note),
            "Compare with care. The two plants are alike, not the same: the paper leaves parameters open "
            "that had to be chosen here, and its pictures were drawn differently. The paper divides its "
            "data frame by frame, so near-identical frames of one exosuit are both learned and tested. "
            "Divided by shape, every tested exosuit is new to the network: the harder and the more honest "
            "question. A study of fewer shapes than the paper's also learns, and is tested, on less.",
        ),
    )


def limits() -> Section:
    """Say what none of this can do."""
    return Section(
        "What it cannot do",
        (
            Points(
                (
                    "It has never seen a real finger, a real exosuit or a real camera. Materials, skin, "
                    "light, background and a camera that moves are not in the data.",
                    "Contact is a frictionless push between spheres. The finger carries a few of them, "
                    "with gaps between that a bent rod can slip into, and the true forces are those of "
                    "this model.",
                    "Every pose is a rest pose. Inertia and the silicone's damping play no part, so a fast "
                    "controller meets a plant that is kinder than a real one.",
                    "There is one finger: its lengths, radii and joint stiffness never change. The "
                    "stiffness of the silicone is one number too, chosen to match the paper's only usable "
                    "data point.",
                    f"The actuation in the training data ends at {published.TRAINING_LIMIT:g} N and never "
                    "pulls. Beyond that, and for shapes outside the five families, an estimate is "
                    "extrapolated.",
                    "The image must show the side view at the scale that was learned. Forces come out "
                    "of any image of the right size, whether or not it shows a finger. `exosight estimate` "
                    "adds intervals, and an OOD score that flags images that differ from the training data; "
                    "the loop above uses neither.",
                )
            ),
        ),
    )


def remake(command: str, config: str, seed: int, versions: Mapping[str, str]) -> Section:
    """Tell how to make this study again.

    command   the line that was run
    config    its whole configuration, as the file that was saved beside the report
    versions  package → version
    """
    rows = tuple(versions.items())
    return Section(
        "How to make it again",
        (
            f"Everything random follows from one seed, {seed}. Other versions of the packages, and other "
            "processors, may round differently, which training amplifies: expect the same picture, not the "
            "same last digits.",
            Listing("The command.", command),
            Listing("The whole configuration of this study.", config),
            Table("versions", "Versions", (Column("package"), Column("version")), rows),
        ),
    )
