"""Numbers over a command, time or pictures: panels of curves over one axis."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from exosight.evaluation.figures.style import (
    BLACK,
    BLUE,
    GRAY,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    few_ticks,
    grid,
    new_figure,
    styled,
)

_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK, GRAY)
_MARKERS = "osD^v<>P"
_FEW = 40
"""Points of a curve up to which each is marked."""


@dataclass(frozen=True, eq=False)
class Curve:
    """One curve; NaN leaves a gap.

    label      in the legend; of the only curve of a panel it is left out
    x, y       (points,)  in the units of the axes
    low, high  (points,)  ends of intervals, drawn as a band
    target     a thin, dashed gray line instead of a coloured one
    """

    label: str
    x: Float[np.ndarray, " points"]
    y: Float[np.ndarray, " points"]
    low: Float[np.ndarray, " points"] | None = None
    high: Float[np.ndarray, " points"] | None = None
    target: bool = False


@dataclass(frozen=True)
class Panel:
    """Curves of one quantity.

    label     of the vertical axis: "F_net [N]"
    group     panels of the same one have the same vertical range; "" has its own
    x_label   of the horizontal axis; "" has that of the figure
    """

    label: str
    curves: tuple[Curve, ...]
    group: str = ""
    x_label: str = ""


@styled
def curves(x_label: str, panels: Sequence[Panel], columns: int = 1) -> Figure:
    """Panels over one another, or in several columns; neighbours above one another share a horizontal label.

    Curves differ in colour, and in marker or dash, so that they can be told apart in print without colour.
    """
    rows = -(-len(panels) // columns)
    figure = new_figure(height=0.6 + (2.0 if columns == 1 else 1.4) * max(rows, 1))
    axes = grid(figure, len(panels), columns)
    first = {panel.group: ax for ax, panel in reversed(list(zip(axes, panels, strict=True))) if panel.group}
    for number, (ax, panel) in enumerate(zip(axes, panels, strict=True)):
        if ax is not first.get(panel.group, ax):
            ax.sharey(first[panel.group])
        place = 0
        for curve in panel.curves:
            if curve.target:
                style: dict[str, Any] = {"color": GRAY, "linestyle": "--", "linewidth": 0.9, "zorder": 1}
            else:
                colour = _COLOURS[place % len(_COLOURS)]
                few = len(curve.x) <= _FEW
                dash = ("-", "--", "-.", ":")[place % 4 if not few else place // len(_COLOURS) % 4]
                style = {"color": colour, "linestyle": dash}
                if few:
                    style |= {"marker": _MARKERS[place % len(_MARKERS)], "markersize": 3}
                place += 1
                if curve.low is not None and curve.high is not None:
                    ax.fill_between(curve.x, curve.low, curve.high, color=colour, alpha=0.25, linewidth=0)
            ax.plot(curve.x, curve.y, label=curve.label, **style)
        ax.set_ylabel(panel.label)
        ax.yaxis.set_major_locator(few_ticks())
        ax.grid()
        below = panels[number + columns :][:1]
        if not below or below[0].x_label != panel.x_label:
            ax.set_xlabel(panel.x_label or x_label)
        if len(panel.curves) > 1:
            ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.align_ylabels()
    return figure
