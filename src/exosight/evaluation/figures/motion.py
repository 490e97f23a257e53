"""The finger and its exosuit: what they are, how they move, and the force along the way."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, UInt8
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from exosight.evaluation.figures.style import (
    BLACK,
    BLUE,
    ESTIMATED,
    GRAY,
    ORANGE,
    TRUE,
    VERMILION,
    WIDTH,
    new_figure,
    show_image,
    styled,
)
from exosight.evaluation.metrics import CONTACTS

_EXOSUIT, _FINGER = "#F6D9C4", "#DCE9F2"


@styled
def overview(
    rod: Float[np.ndarray, "points 2"],
    rod_radii: Float[np.ndarray, " points"],
    finger: Float[np.ndarray, "8 2"],
    finger_radii: Float[np.ndarray, " 8"],
    image: UInt8[np.ndarray, "height width"],
    true: Float[np.ndarray, " 7"],
    estimated: Float[np.ndarray, " 7"],
) -> Figure:
    """The idea in one picture: the system with its parts named, the camera image, the forces (Figs. 1 and 2).

    rod, finger              (points, 2), (8, 2)   x, z of the rod's axis and of the spheres C0…C7 [m]
    rod_radii, finger_radii  (points,), (8,)       [m]
    true, estimated          (7,)                  f_C1…f_C7 of this very image [N]
    """
    figure = new_figure(height=2.5)
    system, camera, answer = figure.subplots(1, 3, width_ratios=(1.6, 1.1, 1.0))
    _draw_finger(system, 100 * finger, 100 * finger_radii)
    _draw_exosuit(system, 100 * rod, 100 * rod_radii)
    system.set(aspect="equal", xlabel="x [cm]", ylabel="z [cm]")
    system.margins(0.12)
    system.set_title("1. The finger and its exosuit")

    show_image(camera, image)
    camera.set_xlabel(f"{image.shape[1]} × {image.shape[0]} pixels, gray")
    camera.set_title("2. What the camera sees")

    place = np.arange(len(CONTACTS))
    answer.barh(place - 0.2, true, height=0.38, color=TRUE, label="true")
    answer.barh(place + 0.2, estimated, height=0.38, color=ESTIMATED, label="estimated")
    answer.set(yticks=place, yticklabels=CONTACTS, xlabel="contact force [N]")
    answer.invert_yaxis()
    answer.legend(loc="best")
    answer.set_title("3. What the network answers")
    for ax in (system, camera, answer):
        ax.set_anchor("N")
    return figure


def sphere_centres(
    joints: Float[np.ndarray, "5 2"], centres_of_mass: Float[np.ndarray, " 4"]
) -> Float[np.ndarray, "8 2"]:
    """Return where C0…C7 lie, for `overview`: at the base and the centre of mass of each link.

    joints           (5, 2)   x, z of the joints and the fingertip [m]
    centres_of_mass  (4,)     distance from the base of each link [m]
    returns          (8, 2)   [m]
    """
    links = np.diff(joints, axis=0)
    along = links / np.linalg.norm(links, axis=1, keepdims=True)
    centres = np.empty((8, 2))
    centres[::2] = joints[:-1]
    centres[1::2] = joints[:-1] + centres_of_mass[:, None] * along
    return centres


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


def _draw_finger(
    ax: Axes, spheres: Float[np.ndarray, "8 2"], radii: Float[np.ndarray, " 8"]
) -> None:  # all in [cm]
    over, under = _sides(spheres, radii)
    ax.add_patch(Polygon(np.vstack([over, under[::-1]]), facecolor=_FINGER, edgecolor="none"))
    for centre, radius in zip(spheres, radii, strict=True):
        ax.add_patch(Circle((centre[0], centre[1]), radius, facecolor=_FINGER, edgecolor="none"))
    outward = under - spheres
    outward[-1] = spheres[-1] - spheres[-3]  # past the fingertip: C6 and C7 lie half a millimetre apart
    outward *= ((radii + 0.4) / np.linalg.norm(outward, axis=1))[:, None]
    for index, (centre, radius, way) in enumerate(zip(spheres, radii, outward, strict=True)):
        ax.add_patch(
            Circle((centre[0], centre[1]), radius, fill=False, edgecolor=TRUE, linewidth=0.5, alpha=0.7)
        )
        ax.plot(*centre, ".", color=TRUE, markersize=3)
        x, z = centre + way
        ax.text(x, z, f"C{index}", ha="center", va="center", fontsize=6.5, color=TRUE)
    _name(ax, "finger", spheres[1], at=(0.2, 0.14))


def _draw_exosuit(
    ax: Axes, axis: Float[np.ndarray, "points 2"], radii: Float[np.ndarray, " points"]
) -> None:  # all in [cm]
    far, near = _sides(axis, radii)
    ax.add_patch(Polygon(np.vstack([far, near[::-1]]), facecolor=_EXOSUIT, edgecolor=GRAY, linewidth=0.5))
    ax.plot(*far.T, color=VERMILION, linewidth=1.6)
    ax.plot([axis[0, 0]] * 2, [near[0, 1], far[0, 1]], color=BLACK, linewidth=3, solid_capstyle="butt")
    third, half = len(axis) // 3, len(axis) // 2
    _name(ax, "line of actuation, u", far[third], at=(0.98, 0.98), color=VERMILION)
    _name(ax, "soft exosuit", axis[half], at=(0.98, 0.86))
    _name(ax, "clamp", axis[0], at=(0.14, 0.98))


def _name(
    ax: Axes, text: str, part: Float[np.ndarray, " 2"], at: tuple[float, float], color: str = BLACK
) -> None:
    """Write a part's name at a place in the panel, with a thin line to the part."""
    ax.annotate(
        text,
        (part[0], part[1]),
        xytext=at,
        textcoords="axes fraction",
        ha="right",
        va="top",
        color=color,
        arrowprops={"arrowstyle": "-", "color": GRAY, "linewidth": 0.6},
    )


def _sides(
    axis: Float[np.ndarray, "points 2"], radii: Float[np.ndarray, " points"]
) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, "points 2"]]:
    """Return the outlines left and right of a tube's axis."""
    tangent = np.gradient(axis, axis=0)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]]) / np.linalg.norm(tangent, axis=1, keepdims=True)
    offset = radii[:, None] * normal
    return axis + offset, axis - offset
