"""Coverage of prediction intervals."""

import numpy as np
from matplotlib.figure import Figure

from exosight.evaluation.coverage import Coverage
from exosight.evaluation.figures.style import (
    BLACK,
    BLUE,
    GRAY,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    legend_above,
    new_figure,
    styled,
)
from exosight.evaluation.naming import forces_only

_COLOURS, _MARKERS = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, BLACK), "os^vDP*"

_KEYS = 7
"""Names in a row of the legend."""


@styled
def reliability(found: Coverage) -> Figure:
    """Share of true values inside the intervals over the promised share, a line an output."""
    promised = 100 * np.array(found.levels)
    figure = new_figure(height=3.0)
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    names = found.schema.outputs
    titles = (
        *("all frames", "estimate zero"),
        "estimate above zero" if forces_only(found.schema) else "estimate not zero",
    )
    for group, (ax, title) in enumerate(zip(panels, titles, strict=True)):
        ax.axline((0, 0), slope=1, color=GRAY, linewidth=0.8, label="as promised")
        for i, name in enumerate(names):
            # Names that share a colour differ in their marker.
            color, marker = _COLOURS[i % 7], _MARKERS[(i + i // 7) % 7]
            inside = 100 * found.share[:, i, group]
            ax.plot(promised, inside, color=color, marker=marker, markersize=4, linewidth=0.9, label=name)
        ax.set(title=title, xlabel="promised [%]", aspect="equal")
        ax.grid()
    lowest = min(promised.min(), 100 * float(np.nanmin(found.share)))
    panels[0].set(
        xlim=(promised.min() - 5, 102),
        ylim=(lowest - 5, 102),
        ylabel="true value inside [% of frames]",
    )
    legend_above(figure, *panels[0].get_legend_handles_labels(), columns=1 + _KEYS)
    return figure
