"""How a system moves, and the force along the way."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, UInt8
from matplotlib.figure import Figure

from exosight.evaluation.figures.style import (
    BLACK,
    BLUE,
    ORANGE,
    WIDTH,
    new_figure,
    show_image,
    styled,
)


@styled
def loading_path(
    u: Float[np.ndarray, " steps"], net_force: Float[np.ndarray, " steps"], snaps: Bool[np.ndarray, " steps"]
) -> Figure:
    """Force on the finger while u rises and falls again; where the pose jumps, the line is dotted.

    u          (steps,)   actuation [N], rising to its largest value, then falling
    net_force  (steps,)   F_net [N]
    snaps      (steps,)   whether the exosuit snapped into another pose since the step before
    """
    figure = new_figure(height=2.8, width=4.5)
    ax = figure.subplots()
    top = int(np.argmax(u))
    # Where the branches coincide, the wide one shows on both sides of the narrow one.
    for name, color, width, branch in (
        ("loading", BLUE, 3.0, slice(0, top + 1)),
        ("unloading", ORANGE, 1.0, slice(top, None)),
    ):
        # NaN breaks the line between the two ends of a jump.
        starts = np.flatnonzero(snaps[branch][1:]) + 1
        ax.plot(
            np.insert(u[branch], starts, np.nan),
            np.insert(net_force[branch], starts, np.nan),
            color=color,
            linewidth=width,
            marker="o",
            markersize=width + 0.5,
            label=name,
        )
    landed = np.flatnonzero(snaps[1:]) + 1
    for number, step in enumerate(landed):
        label = "snap" if number == 0 else None
        ax.plot(u[step - 1 : step + 1], net_force[step - 1 : step + 1], ":", color=BLACK, label=label)
    ax.set(xlabel="actuation u [N]", ylabel="force on the finger F_net [N]")
    ax.grid()
    ax.legend(loc="upper left")
    return figure


def find_snaps(tip: Float[np.ndarray, "steps 2"]) -> Bool[np.ndarray, " steps"]:
    """Tell at which steps of a path the exosuit jumped to another equilibrium, for `loading_path`.

    A jump moves the tip over a millimetre, and five times as far as the median of the six steps around it.
    The steps of load must be even.

    tip      (steps, 2)   x, z of the exosuit's tip [m]
    returns  (steps,)     whether it jumped since the step before
    """
    moved = np.linalg.norm(np.diff(tip, axis=0), axis=1)
    snaps = np.zeros(len(tip), dtype=bool)
    for i, here in enumerate(moved):
        around = np.concatenate([moved[max(i - 3, 0) : i], moved[i + 1 : i + 4]])
        snaps[i + 1] = here > 1e-3 and len(around) > 0 and here > 5 * np.median(around)
    return snaps


@styled
def pose_strip(images: UInt8[np.ndarray, "poses height width"], labels: Sequence[str]) -> Figure:
    """Camera images along the way, each under its label (as above the paper's Fig. 10)."""
    columns = min(len(images), 6)
    rows = -(-len(images) // columns)
    figure = new_figure(
        height=rows * (WIDTH / max(columns, 4) + 0.2), width=WIDTH * columns / max(columns, 4)
    )
    for ax in (panels := figure.subplots(rows, columns, squeeze=False)).flat:
        ax.set_axis_off()
    for ax, image, label in zip(panels.flat, images, labels, strict=False):
        show_image(ax, image)
        ax.set_title(label)
    return figure
