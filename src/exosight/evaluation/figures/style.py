"""One look for every figure: print size, Okabe–Ito colours, light frames, and SVG that never changes."""

import io
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import UInt8
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

BLACK, GRAY = "#000000", "#767676"
ORANGE, SKY, GREEN = "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"
"""Okabe and Ito's palette, told apart by readers of every kind of colour vision."""

TRUE, ESTIMATED, PAPER = BLUE, VERMILION, "#B5B5B5"
"""One colour for one role in every figure."""

WIDTH = 7.0
"""Width of a figure across a printed page [in]."""

# Resolution of what is drawn as pixels inside an SVG (clouds of points), enough for print [1/in].
_DPI = 200

# What would name the moment or the program that wrote it.
_METADATA = {
    "svg": ("Creator", "Date", "Format", "Type"),
    "pdf": ("Creator", "Producer", "CreationDate"),
    "png": ("Software",),
}

_STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "lines.linewidth": 1.2,
    "axes.axisbelow": True,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.5,
    "figure.facecolor": "white",
    "svg.fonttype": "path",  # outlines, so that it looks the same whatever fonts the reader has
    "svg.hashsalt": "exosight",  # names inside the file do not change from run to run
}

styled = matplotlib.rc_context(_STYLE)
"""Decorator: the figure is made in this style and the process-wide settings stay as they were."""


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """Return an empty figure of a printed size [in] that lays itself out."""
    return Figure(figsize=(width, height), layout="constrained")


def grid(figure: Figure, count: int, columns: int, **options: Any) -> list[Axes]:
    """Panels in rows of so many, as many as asked for; what is left of the last row stays empty."""
    rows = -(-count // columns)
    panels = list(figure.subplots(rows, columns, squeeze=False, **options).flat)
    for spare in panels[count:]:
        spare.set_axis_off()
    return panels[:count]


def panel_name(name: str) -> str:
    """A name that fits over a small panel: a long one is broken after an underscore."""
    middle = len(name) // 2
    places = [i + 1 for i, letter in enumerate(name) if letter == "_"]
    if len(name) <= 16 or not places:
        return name
    cut = min(places, key=lambda place: abs(place - middle))
    return f"{name[:cut]}\n{name[cut:]}"


def few_ticks() -> MaxNLocator:
    """Return at most five round ticks, as many as a small panel holds."""
    return MaxNLocator(4, steps=[1, 2, 5, 10])


def show_image(ax: Axes, image: UInt8[np.ndarray, "height width"]) -> None:
    """Show a gray camera image as it is, pixel by pixel."""
    ax.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    ax.set(xticks=[], yticks=[])
    ax.spines[:].set_visible(False)


def legend_above(figure: Figure, handles: Sequence[Artist], labels: Sequence[str], columns: int = 12) -> None:
    """Put one legend for all panels above them, in rows of at most so many names."""
    figure.legend(handles, labels, loc="outside upper center", ncols=min(len(handles), columns))


def to_bytes(figure: Figure, kind: str = "svg") -> bytes:
    """Return the figure as svg (text as outlines), pdf or png: the same bytes for the same figure."""
    buffer = io.BytesIO()
    with matplotlib.rc_context(_STYLE):
        figure.savefig(buffer, format=kind, dpi=_DPI, metadata=dict.fromkeys(_METADATA[kind]))
    return buffer.getvalue()
