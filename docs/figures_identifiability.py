"""Figures and tables of docs/identifiability.md, by simulation: a minute or two on two cores.

What compares with the network is in docs/results/identifiability.json, see docs/identifiability_frames.py.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from _parts.pages import fill, save, table_of
from identifiability import MATERIAL_KNOWN, MATERIAL_VARIES, resolved, sensitivity
from jaxtyping import Float
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from exosight.evaluation.figures.style import BLUE, VERMILION, legend_above, new_figure, styled
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import PublishedDesigns
from exosight.exosuit.shapes import TABLE_I, ExosuitShape, Linear, Sine

HERE = Path(__file__).parent
PAGE, IMAGES = HERE / "identifiability.md", HERE / "images"
RESULT, FRICTION = (HERE / "results" / f"{name}.json" for name in ("identifiability", "friction_view"))

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


@styled
def bounds_and_errors(found: Mapping[str, Any]) -> Figure:
    """Shares of the frames whose bound, and whose network's error, are below some value, a panel a force."""
    shown = {name: row["shown"] for name, row in found.items() if "shown" in row}
    figure = new_figure(height=2.8, width=7.2)
    for ax, (name, values) in zip(
        figure.subplots(1, len(shown), sharey=True, squeeze=False)[0], shown.items(), strict=True
    ):
        for label, key, colour, line in (
            ("one image tells (1 SD)", "resolved [N]", BLUE, "--"),
            ("error of the shipped network", "error [N]", VERMILION, "-"),
        ):
            sizes = np.sort(values[key]) * 1e3
            share = 100 * (np.arange(len(sizes)) + 1) / len(sizes)
            ax.semilogx(sizes, share, line, color=colour, label=label)
        ax.set(title=f"{name}, where it is not 0", xlabel="force [mN]", xlim=(0.01, 100))
    figure.axes[0].set_ylabel("share of the frames [%]")
    legend_above(figure, *figure.axes[0].get_legend_handles_labels())
    return figure


def beside_network(found: Mapping[str, Any]) -> str:
    """The table of bounds and errors, a row a force."""
    rows = []
    for name, of in found.items():
        newtons = (*of["resolved [N]"].values(), of["RMSE where touched [N]"], of["RMSE [N]"])
        rows.append(
            [
                name,
                f"{of['touched [%]']:.0f}",
                *(f"{1e3 * value:.1f}" for value in newtons),
                f"{of['error where not touched [%]']:.0f}",
                *(f"{value:.4f}" for value in (*of["r at the bound"].values(), of["r"])),
            ]
        )
    noises = [f"{noise} pixel" for noise in found["F_net"]["resolved [N]"]]
    heads = (
        *("force", "frames with it [%]", *(f"RMS bound, {noise} [mN]" for noise in noises)),
        *("RMSE of the network there [mN]", "in all frames [mN]", "squared error in frames without it [%]"),
        *(*(f"r at the bound, {noise}" for noise in noises), "r of the network"),
    )
    return table_of(heads, rows)


def with_friction(found: Mapping[str, Any]) -> str:
    """The table of what images of `index-friction` tell: F_net / the worst zone."""
    rows = [
        [f"{name}; u {way}", *(f"{1e3 * net:.1f} / {1e3 * zone:.1f}" for net, zone in cases.values())]
        for name, ways in found.items()
        for way, cases in ways.items()
    ]
    heads = [f"{case} [mN]" for case in next(iter(next(iter(found.values())).values()))]
    return table_of(("exosuit", *heads), rows)


def maps(surfaces: bool) -> tuple[Figure, str]:
    """Figure and table of `published`, or of `index`."""
    cases, rows = {}, []
    for name, shape in SHAPES.items():
        of = sensitivity(Exosuit(shape), LOADS, surfaces)
        for words, prior in (("material known", MATERIAL_KNOWN), ("material known to 10 %", MATERIAL_VARIES)):
            found = resolved(of, prior)
            cases[f"{name}; {words}"] = found
            rows.append(row(f"{name}; {words}", found, of.forces))
    heads = ("exosuit", "one loaded contact [mN]", "two loaded contacts [mN]", "F_net [mN]")
    names = PublishedDesigns().schema.controllable
    return identifiability_map(names, LOADS, cases), table_of(heads, rows)


def main() -> None:
    """Simulate, draw, and put the tables between the page's marks."""
    figure, table = maps(surfaces=False)
    of_index, index_table = maps(surfaces=True)
    found = json.loads(RESULT.read_text())
    save(figure, IMAGES / "identifiability.png", dpi=110)
    save(of_index, IMAGES / "identifiability_index.png", dpi=110)
    save(bounds_and_errors(found), IMAGES / "identifiability_network.png")
    tables = {"resolved": table, "resolved_index": index_table, "network": beside_network(found)}
    fill(PAGE, tables | {"friction": with_friction(json.loads(FRICTION.read_text()))})


if __name__ == "__main__":
    main()
