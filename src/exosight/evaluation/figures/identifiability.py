"""Which forces one view resolves, and how small."""

from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from exosight.evaluation.figures.style import new_figure, styled

_FREE = "#EEEEEE"
_RANGE = (1e-4, 0.1)
"""Forces between which colours differ [N]."""


@styled
def identifiability_map(
    names: Sequence[str],
    u: Float[np.ndarray, " loads"],
    cases: Mapping[str, Float[np.ndarray, "loads forces"]],
) -> Figure:
    """Smallest force that an outline resolves, forces over actuation, a panel a case; gray where free.

    names   of the forces
    cases   title → smallest force that is resolved at the actuations u [N], NaN where a contact is free [N]
    """
    figure = new_figure(height=0.5 + 1.25 * len(cases))
    panels = figure.subplots(len(cases), 1, sharex=True, squeeze=False)[:, 0]
    colours = matplotlib.colormaps["viridis"].with_extremes(bad=_FREE)
    mesh = None
    for ax, (title, found) in zip(panels, cases.items(), strict=True):
        shown = np.ma.masked_invalid(found.T)
        mesh = ax.pcolormesh(
            u, np.arange(len(names)), shown, cmap=colours, norm=LogNorm(*_RANGE), shading="nearest"
        )
        mesh.set_rasterized(True)
        ax.set_facecolor(_FREE)
        ax.set_yticks(np.arange(len(names)), names)
        ax.invert_yaxis()
        ax.set_title(title)
    panels[-1].set_xlabel("actuation u [N]")
    if mesh is not None:
        figure.colorbar(
            mesh,
            ax=panels,
            label="smallest force resolved [N]",
            extend="both",
            pad=0.01,
            aspect=40,
            shrink=0.7,
        )
    return figure
