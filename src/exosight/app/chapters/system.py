"""Sections on the system: what it is, how it moves, what was simulated."""

import numpy as np
from matplotlib.figure import Figure

from exosight.app.report import Picture, Section
from exosight.app.results import DataSummary, PathSummary
from exosight.evaluation import figures, published
from exosight.evaluation.naming import contacts, span
from exosight.evaluation.tables import OURS, PAPER, Cell, Column, Table
from exosight.system.schema import Schema


def introduction(overview: Figure, schema: Schema) -> Section:
    """Say what the system is to a reader who meets it for the first time."""
    outputs, spheres = span(schema.outputs), span(contacts(schema))
    return Section(
        "System",
        (
            "A soft exosuit is a silicone rod worn along the back of a finger. Actuated, it bends and "
            "pushes the finger closed. How hard it pushes, and where, is difficult to measure: a sensor "
            "between skin and silicone is in the way. Here the forces are read from a picture instead. A "
            "network takes one small gray image of finger and exosuit and estimates forces in newtons, one "
            f"for each place {outputs} on the finger where the two may touch. Their sum is "
            f"{schema.controlled}, the net force on the finger, and a controller can use it in place of a "
            "sensor.",
            Picture(
                overview,
                "From pose to forces. 1: the exosuit is clamped beside the base of the finger; the "
                "actuation u acts along the line on its back. Circles are the spheres of the contact "
                f"model, {spheres}, on three phalanges and the fingertip. 2: the camera image of this pose, "
                "the network's only input. 3: its answer beside the true forces of the simulation.",
                f"Side view of a bent soft exosuit on a finger with the contacts {spheres} named, the gray "
                f"camera image of the same pose, and a bar chart of true and estimated forces at {outputs}.",
            ),
            f"Everything here is simulated. The system is the one of {published.SOURCE}, called the paper "
            "below; its results stand beside those of this study.",
        ),
    )


def motion(path: PathSummary) -> Section:
    """Show how the exosuit moves and what force that brings."""
    chosen = np.linspace(0, int(np.argmax(path.u)), 6).round().astype(int)
    snaps = int(path.snaps.sum())
    return Section(
        "Loading path",
        (
            "Each pose is a stable equilibrium: a minimum of the potential energy of rod, joints, contact "
            "and actuation. The actuation u rises from 0 N and falls back, and each pose is the start of "
            "the next.",
            Picture(
                figures.pose_strip(path.images[chosen], [f"u = {path.u[i]:.1f} N" for i in chosen]),
                "Camera images while u rises.",
                f"{len(chosen)} gray images of the exosuit bending the finger further and further.",
            ),
            Picture(
                figures.loading_path(path.u, path.net_force, path.snaps),
                f"Net force on the finger over the actuation. On this path the exosuit snaps {snaps} "
                f"{'time' if snaps == 1 else 'times'} from one stable pose to another (dotted). A snap may "
                "come at another load on the way back than on the way up: then the two branches differ in "
                "between, although nothing here has friction.",
                "Line plot of F_net over u, one branch for rising and one for falling actuation.",
            ),
        ),
    )


def data_section(data: DataSummary) -> Section:
    """Count what was simulated, left out and kept, and how it was divided."""
    kept, dropped = sum(data.kept.values()), sum(data.dropped.values())
    rows: list[tuple[Cell, ...]] = [("simulated", kept + dropped, published.FRAMES_SIMULATED)]
    rows += [(f"dropped: {cause}", count, None) for cause, count in data.dropped.items()]
    rows.append(("dropped, all causes", dropped, published.FRAMES_SIMULATED - published.FRAMES_KEPT))
    rows.append(("kept", kept, published.FRAMES_KEPT))
    families = tuple((family, count) for family, count in data.kept.items())
    splits = tuple((name, *counts) for name, counts in data.splits.items())
    return Section(
        "Data",
        (
            f"{data.shapes} exosuit shapes from five families of surfaces were each driven from 0 N to "
            f"{published.TRAINING_LIMIT:g} N and back. Every frame is an image with its true forces.",
            Table("frames", "Frames", (Column("frames"), Column(OURS), Column(PAPER)), tuple(rows)),
            Table(
                "families", "Frames kept, by family of shapes", (Column("family"), Column("frames")), families
            ),
            Table(
                "splits",
                "How the frames are divided",
                (Column("split"), Column("training"), Column("validation"), Column("test")),
                splits,
                "By frame: frames at random, as in the paper. By shape: all frames of one exosuit fall on "
                "the same side. By family: the test frames come from a family of which nothing is learned.",
            ),
        ),
    )
