"""Figure and table of docs/identifiability.md, by simulation: a minute or two on two cores."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from _parts.pages import fill, save, table_of
from identifiability import MATERIAL_KNOWN, MATERIAL_VARIES, resolved, sensitivity
from jaxtyping import Float
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from exosight.evaluation.figures.style import new_figure, styled
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import PublishedDesigns
from exosight.exosuit.shapes import TABLE_I, ExosuitShape, Linear, Sine

HERE = Path(__file__).parent
PAGE, IMAGE = HERE / "identifiability.md", HERE / "images" / "identifiability.png"

SHAPES = {
    "taper of 5.8 to 4 mm, 100 mm long (published)": TABLE_I,
    "taper of 9.5 to 5.5 mm, 95 mm long": ExosuitShape(Linear(r0=0.0095, r1=0.0055), length=0.095),
    "waves about 7 mm, 105 mm long": ExosuitShape(Sine(r0=0.007, a=-9.0), length=0.105),
}
LOADS = np.arange(0.1, 4.01, 0.1)
FREE = "#EEEEEE"
"""Colour where a contact is free."""
RANGE = (1e-4, 0.1)
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
    colours = matplotlib.colormaps["viridis"].with_extremes(bad=FREE)
    mesh = None
    for ax, (title, found) in zip(panels, cases.items(), strict=True):
        shown = np.ma.masked_invalid(found.T)
        mesh = ax.pcolormesh(
            u, np.arange(len(names)), shown, cmap=colours, norm=LogNorm(*RANGE), shading="nearest"
        )
        mesh.set_rasterized(True)
        ax.set_facecolor(FREE)
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


def row(name: str, found: np.ndarray, forces: np.ndarray) -> list[str]:
    """Medians over the actuations with one and with two loaded contacts, and of F_net."""
    pressing = (forces > 0).sum(axis=1)
    cells = [
        np.nanmedian(found[pressing == count, :7]) if (pressing == count).any() else np.nan
        for count in (1, 2)
    ]
    cells.append(np.nanmedian(found[:, 7]))
    return [name, *("–" if np.isnan(c) else f"{1000 * c:.2f}" for c in cells)]


def main() -> None:
    """Simulate, draw, and put the table between the page's marks."""
    cases, rows = {}, []
    for name, shape in SHAPES.items():
        of = sensitivity(Exosuit(shape), LOADS)
        for words, prior in (("material known", MATERIAL_KNOWN), ("material known to 10 %", MATERIAL_VARIES)):
            found = resolved(of, prior)
            cases[f"{name}; {words}"] = found
            rows.append(row(f"{name}; {words}", found, of.forces))
    save(identifiability_map(PublishedDesigns().schema.controllable, LOADS, cases), IMAGE, dpi=110)
    heads = ("exosuit", "one loaded contact [mN]", "two loaded contacts [mN]", "F_net [mN]")
    fill(PAGE, {"resolved": table_of(heads, rows)})


if __name__ == "__main__":
    main()
