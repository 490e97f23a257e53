"""What degraded images look like, and what they cost."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import UInt8
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from exosight.evaluation.figures.style import (
    ESTIMATED,
    PAPER,
    WIDTH,
    legend_above,
    new_figure,
    show_image,
    styled,
)
from exosight.evaluation.metrics import Scores
from exosight.evaluation.naming import common_unit
from exosight.evaluation.published import ROBUSTNESS_PUBLISHED, is_published


@styled
def corrupted_examples(examples: Mapping[str, UInt8[np.ndarray, "frames height width"]]) -> Figure:
    """The same frames, a column a case ("clean" and each corruption), a row a frame (Fig. 3)."""
    rows = len(next(iter(examples.values())))
    size = WIDTH / len(examples)
    figure = new_figure(height=rows * size + 0.3)
    panels = figure.subplots(rows, len(examples), squeeze=False)
    for column, (name, images) in enumerate(examples.items()):
        panels[0, column].set_title(_words(name))
        for row, image in enumerate(images):
            show_image(panels[row, column], image)
    return figure


@styled
def robustness_bars(cases: Mapping[str, Scores]) -> Figure:
    """Mean ± SD over the outputs of RMSE, RMS% and r for each case; of the published system beside Table 4.

    RMSE is left out where the outputs have several units.
    """
    names = list(cases)
    place = np.arange(len(names))
    schema = next(iter(cases.values())).schema
    sources: list[tuple[str, Mapping[str, Any], str]] = [("exosight", cases, ESTIMATED)]
    if is_published(schema):
        sources.append(("paper", ROBUSTNESS_PUBLISHED, PAPER))
    metrics = [("rms_percent", "RMS% [% of range]"), ("r", "Pearson r [-]")]
    if unit := common_unit(schema):
        metrics.insert(0, ("rmse", f"RMSE [{unit}]"))
    figure = new_figure(height=2.7)
    panels = figure.subplots(1, len(metrics))
    shifts = (-0.2, 0.2) if len(sources) == 2 else (0.0,)
    for ax, (metric, label) in zip(panels, metrics, strict=True):
        for (_, source, color), shift in zip(sources, shifts, strict=True):
            spreads = [getattr(source[name], metric) for name in names]
            ax.bar(
                place + shift,
                [s.mean for s in spreads],
                yerr=[s.sd for s in spreads],
                width=0.38,
                color=color,
                error_kw={"linewidth": 0.8, "capsize": 1.5},
            )
        ax.set_ylabel(label)
        ax.set_xticks(
            place, [_words(name) for name in names], rotation=40, ha="right", rotation_mode="anchor"
        )
        # Whiskers of one SD may leave what the quantity can be; the axis does not.
        lowest = min(0.0, *(cases[name].r.mean for name in names)) if metric == "r" else 0.0
        ax.set_ylim(lowest, 1.0 if metric == "r" else None)
        ax.grid(axis="y")
    keys = [Patch(color=color) for _, _, color in sources]
    legend_above(figure, keys, [name for name, _, _ in sources])
    return figure


def _words(name: str) -> str:
    return name.replace("-", ", ")
