"""The section on the closed loop."""

from collections.abc import Sequence

import numpy as np

from exosight.app.control_figures import steady_states, step_responses
from exosight.app.report import Picture, Section
from exosight.app.results import LoopResult
from exosight.control import Trial
from exosight.evaluation import figures, published
from exosight.evaluation.tables import OURS, PAPER, Cell, Column, Table

_SHIPPED = (
    "This is the network that comes with exosight and is used by the command exosight estimate. It was "
    "trained longer, on thousands of exosuits, but not on the controller's (see its model card). Exosuits of "
    "this study may be among its training data, so its accuracy on them is not reported."
)


def closed_loop(loop: LoopResult) -> Section:
    """Show the controller with an estimator as its force sensor, beside the paper's results."""
    constant, steps = loop.constant, loop.steps
    # The paper's own figure shows the poses of K_P = 1.
    shown = min(steps, key=lambda trial: abs(trial.gain - 1)).record
    moments = np.linspace(0, len(shown.time) - 1, 6).round().astype(int)
    return Section(
        f"Closed loop: {loop.name}",
        (
            "The controller uses images alone. At each step the network estimates F_net, and the actuation "
            "is raised by K_P times the difference between target and estimate. The true F_net is known to "
            "the simulation and is drawn for comparison; the controller does not use it.",
            *((_SHIPPED,) if loop.shipped else ()),
            Picture(
                steady_states([trial.record for trial in constant]),
                f"Constant targets, K_P = {constant[0].gain:g}. Above: the true force of the simulation and "
                "the force that the network estimated from the images. Below: the actuation; the dotted line "
                "is the largest one in the training data.",
                "Line plots over time of true and estimated F_net for each target, and of the actuation "
                "below.",
            ),
            _constant_table(constant, loop.folder),
            Picture(
                step_responses({trial.law: trial.record for trial in steps}),
                "Step responses: the target is held, then switched to 0 N. Error: target minus estimate, the "
                "input of the controller.",
                "Line plots over time of F_net, error and actuation, a line for each gain.",
            ),
            Picture(
                figures.pose_strip(shown.images[moments], [f"t = {t:g} s" for t in shown.time[moments]]),
                "Camera images along the step response with K_P = 1.",
                f"{len(moments)} gray images of finger and exosuit during the step response.",
            ),
            _step_table(steps, loop.folder),
        ),
    )


def target_of(trial: Trial) -> float:
    """The target before it is released [N]."""
    return float(trial.record.target[0])


def published_steps(trial: Trial) -> int | None:
    """Return the steps that the paper's controller took to settle at this target, if it had it."""
    for paper in published.STEADY_STATES_PUBLISHED:
        if np.isclose(paper.target, target_of(trial)):
            return paper.settling_steps
    return None


def _constant_table(trials: Sequence[Trial], suffix: str) -> Table:
    columns = (
        Column("target", "N", digits=2),
        Column(OURS, "", "steps to settle"),
        Column(PAPER, "", "steps to settle"),
        Column("overshoot", "N", digits=3),
        Column("steady-state error", "N", digits=3),
        Column("largest u", "N", digits=2),
    )
    rows = tuple(
        (
            *(target_of(trial), trial.settling_steps, published_steps(trial)),
            *(trial.response.overshoot, trial.response.steady_state_error),
            float(trial.record.command.max()),
        )
        for trial in trials
    )
    note = "Measured on the true force. A dash: not settled within the run, or not tested in the paper."
    return Table(f"steady_states_{suffix}", "Constant targets", columns, rows, note)


def _step_table(trials: Sequence[Trial], suffix: str) -> Table:
    columns = (
        Column("K_P"),
        Column("before the switch", "N", "true F_net", 3),
        Column("largest", "N", "true F_net", 3),
        Column("at the end", "N", "true F_net", 3),
        Column("largest", "N", "actuation u", 2),
        Column("smallest", "N", "actuation u", 2),
        Column(PAPER),
    )
    outcomes = {paper.gain: paper.outcome for paper in published.STEPS_PUBLISHED}
    rows: list[tuple[Cell, ...]] = []
    for trial in trials:
        record = trial.record
        force, held = record.true, np.flatnonzero(record.target > 0)
        rows.append(
            (
                *(trial.gain, float(force[held[-1]]), float(force.max()), float(force[-1])),
                *(float(record.command.max()), float(record.command.min()), outcomes.get(trial.gain)),
            )
        )
    caption = f"Step to {target_of(trials[0]):g} N and back to 0 N"
    return Table(f"step_responses_{suffix}", caption, columns, tuple(rows))
