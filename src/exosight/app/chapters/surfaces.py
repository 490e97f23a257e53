"""The section on what the model of contact changes: `published` beside `index`."""

from collections.abc import Mapping, Sequence

import numpy as np

from exosight.app.chapters.loop import published_steps, target_of
from exosight.app.report import Picture, Section
from exosight.app.results import LoopResult, PathSummary, SurfaceResult
from exosight.evaluation import figures
from exosight.evaluation.published import CONTACTS_PUBLISHED, FRAMES_KEPT, FRAMES_SIMULATED
from exosight.evaluation.tables import Cell, Column, Table, sensor_table

STORED: Mapping[str, tuple[float, float, tuple[float, ...]]] = {
    "published": (75.1, 11.0, (0.9954, 0.9989, 0.9985, 0.9990, 0.9987, 0.9977, 0.9699)),
    "index": (98.8, 3.7, (0.9998, 0.9998, 0.9998, 0.9999, 0.9998, 0.9995, 0.9933)),
}
"""Of each system: frames kept of the paper's dataset [%], and, of its shipped network on unseen exosuits,
RMSE of F_net [mN] and r of C1…C7, see the model cards."""


def contact_models(path: PathSummary, surfaces: SurfaceResult, loops: Sequence[LoopResult]) -> Section:
    """Show the path, the data, the accuracy and the loop of both systems.

    path   of `published`, with the same exosuit
    loops  of `published`
    """
    own = surfaces.result
    return Section(
        "Contact of surfaces",
        (
            "All of the above has the paper's contact, between spheres on exosuit and finger. The system "
            "index is the same finger and the same exosuits with contact of their surfaces, also of an "
            "exosuit with itself, and with images in which the depth of contact does not show.",
            Picture(
                figures.curves("actuation u [N]", [_panel("published", path), _panel("index", surfaces)], 2),
                "Net force on the finger over the actuation for the controller's exosuit. On spheres it "
                "slips from one to the next, and the force jumps over a target; on smooth surfaces each "
                "target lies on one branch. Dashed: the targets.",
                "Two line plots of F_net over u, one for each system, each with a branch for rising and one "
                "for falling actuation.",
            ),
            *([sensor_table("contacts_index", f"Each contact: {own.name}", own.scores)] if own else []),
            _stored_table(),
            _loop_table([*loops, *surfaces.loops]),
        ),
    )


def _panel(name: str, path: PathSummary | SurfaceResult) -> figures.Panel:
    top = int(np.argmax(path.u))
    ends = np.array([0.0, path.u[top]])
    targets = (0.25, 0.30, 0.35)
    return figures.Panel(
        f"{name}: F_net [N]",
        (
            figures.Curve("u rising", path.u[: top + 1], path.net_force[: top + 1]),
            figures.Curve("u falling", path.u[top:], path.net_force[top:]),
            *(figures.Curve("", ends, np.full(2, target), target=True) for target in targets),
        ),
        group="F_net",
    )


def _stored_table() -> Table:
    columns = (
        Column("system"),
        Column("frames kept", "%", digits=1),
        Column("RMSE of F_net", "mN", digits=1),
        *(Column(contact.name, "", "r on unseen exosuits", 4) for contact in CONTACTS_PUBLISHED),
    )
    rows: list[tuple[Cell, ...]] = [(name, kept, error, *r) for name, (kept, error, r) in STORED.items()]
    own = (contact.r for contact in CONTACTS_PUBLISHED)
    rows.append(("paper, by frame", 100 * FRAMES_KEPT / FRAMES_SIMULATED, None, *own))
    note = (
        "Of the shipped networks and the paper's dataset of 1375 exosuits, not of this study. On index the "
        "exosuit presses on itself where frames of published, in which it crosses itself, are dropped."
    )
    return Table("contact_models", "Data and accuracy, stored results", columns, tuple(rows), note)


def _loop_table(loops: Sequence[LoopResult]) -> Table:
    trials = loops[0].constant
    targets = [f"{target_of(trial):.2f}\N{NO-BREAK SPACE}N" for trial in trials]
    groups = ("steps to settle at", "overshoot at")
    columns = (
        Column("network"),
        *(Column(target, "", groups[0]) for target in targets),
        *(Column(target, "%", groups[1], 0) for target in targets),
    )
    rows: list[tuple[Cell, ...]] = [
        (
            loop.name,
            *(trial.settling_steps for trial in loop.constant),
            *(float(trial.response.overshoot_percent) for trial in loop.constant),
        )
        for loop in loops
    ]
    rows.append(("paper", *(published_steps(trial) for trial in trials), *[None] * len(trials)))
    note = f"K_P = {trials[0].gain:g}, images alone, run in this study. A dash: not settled within the run."
    return Table(
        "contact_models_loop", "The paper's law with both models of contact", columns, tuple(rows), note
    )
