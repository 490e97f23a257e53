"""Controllers under stress: how episodes are spread over what was measured."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from exosight.evaluation.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    PURPLE,
    VERMILION,
    legend_above,
    new_figure,
    styled,
)

_LOOKS = ((BLUE, "-"), (VERMILION, "--"), (GREEN, "-."), (PURPLE, ":"))


@dataclass(frozen=True)
class Spread:
    """One quantity of all episodes.

    label        of its axis, with the unit
    values       controller → what 0, 1 … 100 % of the episodes do not pass; NaN where so many never got there
    limit        beyond which it should not go, or None
    largest      end of the axis
    """

    label: str
    values: Mapping[str, Float[np.ndarray, "101"]]
    limit: float | None
    largest: float


@styled
def stress(spreads: Sequence[Spread]) -> Figure:
    """The share of episodes up to each value, a panel a quantity, a line a controller.

    A line ends below 100 % where something never happened, and leaves the panel where it is off the axis.
    """
    figure = new_figure(height=4.4)
    panels = figure.subplots(2, (len(spreads) + 1) // 2, squeeze=False)
    lines = {}
    for ax, spread in zip(panels.flat, spreads, strict=False):
        for (name, values), (colour, dash) in zip(spread.values.items(), _LOOKS, strict=False):
            share = np.arange(101)[~np.isnan(values)]
            ends = np.append(values[~np.isnan(values)], np.inf).clip(max=2 * spread.largest)
            shares = np.append(share, share[-1:] if len(share) else [0])
            (lines[name],) = ax.step(ends, shares, where="post", color=colour, linestyle=dash)
        if spread.limit is not None:
            ax.axvline(spread.limit, color=BLACK, linewidth=0.8, linestyle=(0, (1, 2)))
        ax.set(xlabel=spread.label, xlim=(0, spread.largest), ylim=(0, 102))
        ax.grid()
    for row in panels:
        row[0].set_ylabel("share of episodes [%]")
    legend_above(figure, list(lines.values()), list(lines))
    return figure
