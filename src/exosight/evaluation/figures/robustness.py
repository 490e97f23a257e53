"""What degraded images look like, and what they cost."""

from collections.abc import Mapping

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
from exosight.evaluation.published import ROBUSTNESS_PUBLISHED


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
    """Mean ± SD over C1…C7 of RMSE, RMS% and r for each case, beside the paper's Table 4."""
    names = list(cases)
    place = np.arange(len(names))
    figure = new_figure(height=2.7)
    panels = figure.subplots(1, 3)
    metrics = (("rmse", "RMSE [N]"), ("rms_percent", "RMS% [% of range]"), ("r", "Pearson r [-]"))
    for ax, (metric, label) in zip(panels, metrics, strict=True):
        for source, color, shift in ((cases, ESTIMATED, -0.2), (ROBUSTNESS_PUBLISHED, PAPER, 0.2)):
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
    keys = [Patch(color=color) for color in (ESTIMATED, PAPER)]
    legend_above(figure, keys, ["exosight", "paper"])
    return figure


def _words(name: str) -> str:
    return name.replace("-", ", ")
