"""Pictures with the outlines of the bodies that were found in them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import UInt8
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from exosight.evaluation.figures.style import (
    GRAY,
    GREEN,
    ORANGE,
    SKY,
    VERMILION,
    grid,
    legend_above,
    new_figure,
    panel_name,
    styled,
)
from exosight.rig.identification.outlines import UNKNOWN

COLOURS = (VERMILION, SKY, GREEN, ORANGE)
Shown = tuple[str, UInt8[np.ndarray, "rows columns 3"], UInt8[np.ndarray, "rows columns"]]


@styled
def mask_figure(pictures: Sequence[Shown], bodies: Sequence[str]) -> Figure:
    """Pictures and their masks, by name; bodies in the order of their numbers."""
    columns = min(len(pictures), 3)
    figure = new_figure(height=0.4 + 2.4 * -(-len(pictures) // columns), width=2.4 * columns)
    labels = [*bodies, "not known"]
    drawn = [(k + 1, COLOURS[k % len(COLOURS)]) for k in range(len(bodies))] + [(UNKNOWN, GRAY)]
    for axes, (name, picture, mask) in zip(grid(figure, len(pictures), columns), pictures, strict=True):
        axes.imshow(picture, interpolation="nearest")
        for number, colour in drawn:
            if (mask == number).any():
                axes.contour(mask == number, levels=[0.5], colors=colour, linewidths=0.8)
        axes.set(xticks=[], yticks=[], title=panel_name(name))
        axes.spines[:].set_visible(False)
    legend_above(figure, [Line2D([], [], color=colour) for _, colour in drawn], labels)
    return figure
