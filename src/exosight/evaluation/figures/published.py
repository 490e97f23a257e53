"""The published system in one picture: finger and exosuit, camera image, estimated forces."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from exosight.evaluation.figures.style import (
    BLACK,
    ESTIMATED,
    GRAY,
    TRUE,
    VERMILION,
    new_figure,
    show_image,
    styled,
)

_EXOSUIT, _FINGER = "#F6D9C4", "#DCE9F2"


@dataclass(frozen=True)
class Outline:
    """Spheres along a body in the plane of the picture.

    centres   (spheres, 2)   x, z [m]
    radii     (spheres,)     [m]
    """

    centres: Float[np.ndarray, "spheres 2"]
    radii: Float[np.ndarray, " spheres"]


@styled
def overview(
    rod: Outline,
    finger: Outline,
    spheres: Sequence[str],
    image: UInt8[np.ndarray, "height width"],
    forces: Mapping[str, tuple[float, float]],
) -> Figure:
    """The idea in one picture: the system with its parts named, the camera image, the forces (Figs. 1 and 2).

    rod, finger   the rod's axis, and the spheres of the finger
    spheres       names of the sensors on these
    forces        name of a sensor → its true and its estimated force for this very image [N]
    """
    figure = new_figure(height=2.5)
    system, camera, answer = figure.subplots(1, 3, width_ratios=(1.6, 1.1, 1.0))
    _draw_finger(system, 100 * finger.centres, 100 * finger.radii, spheres)
    _draw_exosuit(system, 100 * rod.centres, 100 * rod.radii)
    system.set(aspect="equal", xlabel="x [cm]", ylabel="z [cm]")
    system.margins(0.12)
    system.set_title("1. Finger and exosuit")

    show_image(camera, image)
    camera.set_xlabel(f"{image.shape[1]} × {image.shape[0]} pixels, gray")
    camera.set_title("2. Camera image")

    place = np.arange(len(forces))
    true, estimated = np.array(list(forces.values())).T
    answer.barh(place - 0.2, true, height=0.38, color=TRUE, label="true")
    answer.barh(place + 0.2, estimated, height=0.38, color=ESTIMATED, label="estimated")
    answer.set(yticks=place, yticklabels=list(forces), xlabel="contact force [N]")
    answer.invert_yaxis()
    answer.legend(loc="best")
    answer.set_title("3. Estimated contact forces")
    for ax in (system, camera, answer):
        ax.set_anchor("N")
    return figure


def _draw_finger(
    ax: Axes,
    spheres: Float[np.ndarray, "spheres 2"],
    radii: Float[np.ndarray, " spheres"],
    names: Sequence[str],
) -> None:  # all in [cm]
    over, under = _sides(spheres, radii)
    ax.add_patch(Polygon(np.vstack([over, under[::-1]]), facecolor=_FINGER, edgecolor="none"))
    for centre, radius in zip(spheres, radii, strict=True):
        ax.add_patch(Circle((centre[0], centre[1]), radius, facecolor=_FINGER, edgecolor="none"))
    outward = under - spheres
    outward[-1] = spheres[-1] - spheres[-3]  # past the fingertip: the last two lie half a millimetre apart
    outward *= ((radii + 0.4) / np.linalg.norm(outward, axis=1))[:, None]
    for name, centre, radius, way in zip(names, spheres, radii, outward, strict=True):
        ax.add_patch(
            Circle((centre[0], centre[1]), radius, fill=False, edgecolor=TRUE, linewidth=0.5, alpha=0.7)
        )
        ax.plot(*centre, ".", color=TRUE, markersize=3)
        x, z = centre + way
        ax.text(x, z, name, ha="center", va="center", fontsize=6.5, color=TRUE)
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
