"""Estimated against true contact forces on frames the estimator has not learned from."""

import numpy as np
from jaxtyping import Bool, Float
from matplotlib import mlab
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from exosight.evaluation.details import TOUCHING
from exosight.evaluation.figures.style import (
    BLACK,
    ESTIMATED,
    GRAY,
    TRUE,
    few_ticks,
    legend_above,
    new_figure,
    styled,
)
from exosight.evaluation.metrics import CONTACTS, NET_FORCE, score

# A contact that happens to be free in all samples must not blow up the estimator's noise [N].
_SMALLEST_SCALE = 0.05


def _with_net(forces: Float[np.ndarray, "frames 7"]) -> Float[np.ndarray, "frames 8"]:
    return np.column_stack([forces, forces.sum(axis=1)])


@styled
def sample_traces(
    true: Float[np.ndarray, "frames 7"],
    estimated: Float[np.ndarray, "frames 7"],
    samples: int = 60,
    seed: int = 0,
) -> Figure:
    """True and estimated force of every contact, and of their sum, for a random set of frames (Fig. 6)."""
    chosen = np.random.default_rng(seed).permutation(len(true))[:samples]
    truth, answer = _with_net(true)[chosen], _with_net(estimated)[chosen]
    number = np.arange(1, len(chosen) + 1)
    figure = new_figure(height=5.4)
    panels = figure.subplots(4, 2, sharex=True).T.flat
    handles: list[Line2D] = []
    for ax, name, t, e in zip(panels, (*CONTACTS, NET_FORCE), truth.T, answer.T, strict=True):
        ax.vlines(number, t, e, color=GRAY, linewidth=0.6)
        handles = [
            *ax.plot(number, t, "o", color=TRUE, markersize=3.6, markerfacecolor="none", markeredgewidth=0.8),
            *ax.plot(number, e, ".", color=ESTIMATED, markersize=3.6),
        ]
        ax.set_ylabel(f"{name} [N]")
        ax.set_ylim(top=max(ax.get_ylim()[1], _SMALLEST_SCALE))
        ax.yaxis.set_major_locator(few_ticks())
        ax.grid(axis="y")
        if ax.get_subplotspec().is_last_row():
            ax.set_xlabel("sample (random frames) [-]")
    figure.align_ylabels()
    legend_above(figure, handles, ["true", "estimated"])
    return figure


@styled
def predicted_against_true(
    true: Float[np.ndarray, "frames 7"], estimated: Float[np.ndarray, "frames 7"]
) -> Figure:
    """Density of estimated over true force with the identity line, r and RMSE, a panel a contact (Fig. 7)."""
    scores = score(true, estimated)
    figure = new_figure(height=4.1)
    panels = figure.subplots(2, 4)
    cells = []
    for ax, metrics, t, e in zip(
        panels.flat, (*scores.contacts, scores.net), _with_net(true).T, _with_net(estimated).T, strict=True
    ):
        low, high = min(0.0, t.min(), e.min()), max(t.max(), e.max(), 1e-6)
        margin = 0.04 * (high - low)
        limits = (low - margin, high + margin)
        ax.plot(limits, limits, color=BLACK, linewidth=0.7, label="identity")
        hexagons = ax.hexbin(t, e, gridsize=36, extent=(*limits, *limits), mincnt=1, linewidths=0.1, zorder=2)
        hexagons.set_rasterized(True)
        cells.append(hexagons)
        ax.set(xlim=limits, ylim=limits, aspect="equal")
        ax.xaxis.set_major_locator(few_ticks())
        ax.yaxis.set_major_locator(few_ticks())
        r = "–" if np.isnan(metrics.r) else f"{metrics.r:.3f}"
        ax.set_title(f"{metrics.name}: r = {r}\nRMSE {metrics.rmse:.3f} N")
    largest = max((float(c.get_array().max()) for c in cells if len(c.get_array())), default=1.0)
    norm = LogNorm(1, max(largest, 10.0))
    for hexagons in cells:
        hexagons.set_norm(norm)
    figure.colorbar(cells[0], ax=panels, label="frames in a cell [-]", pad=0.01, aspect=40, shrink=0.8)
    figure.supxlabel("true force [N]", fontsize=8)
    figure.supylabel("estimated force [N]", fontsize=8)
    return figure


@styled
def rainclouds(
    true: Float[np.ndarray, "frames 7"], estimated: Float[np.ndarray, "frames 7"], seed: int = 0
) -> Figure:
    """Distributions where a contact touches: estimated above, true below; cloud, box and points (Fig. 7).

    Most frames leave most contacts free, so clouds of all frames would be one spike at 0 N; only frames
    whose true force reaches TOUCHING are drawn, and each panel says how many of all frames these are.
    """
    truth, answer = _with_net(true), _with_net(estimated)
    rng = np.random.default_rng(seed)
    figure = new_figure(height=3.8)
    panels = figure.subplots(2, 4).flat
    for ax, name, t, e in zip(panels, (*CONTACTS, NET_FORCE), truth.T, answer.T, strict=True):
        touching: Bool[np.ndarray, " frames"] = t >= TOUCHING
        ax.axhline(0, color=GRAY, linewidth=0.5)
        if touching.any():
            _half_raincloud(ax, e[touching], side=1.0, color=ESTIMATED, rng=rng)
            _half_raincloud(ax, t[touching], side=-1.0, color=TRUE, rng=rng)
        ax.set(ylim=(-1.2, 1.2), yticks=[])
        ax.spines["left"].set_visible(False)
        ax.xaxis.set_major_locator(few_ticks())
        ax.set_title(f"{name}: touching in {100 * touching.mean():.0f} %")
    figure.supxlabel("force [N]", fontsize=8)
    keys = [Line2D([], [], color=color, linewidth=6, alpha=0.6) for color in (ESTIMATED, TRUE)]
    legend_above(figure, keys, ["estimated (above)", "true (below)"])
    return figure


def _half_raincloud(
    ax: Axes, values: Float[np.ndarray, " n"], side: float, color: str, rng: np.random.Generator
) -> None:
    # Counted from the middle line outwards: points, box, cloud.
    shown = rng.permutation(values)[:300]
    jitter = rng.uniform(0.06, 0.28, len(shown))
    ax.plot(
        shown, side * jitter, ".", color=color, markersize=2, alpha=0.4, markeredgewidth=0, rasterized=True
    )
    line = {"color": color, "linewidth": 0.8}
    ax.boxplot(
        values,
        orientation="horizontal",
        positions=[side * 0.38],
        widths=0.12,
        showfliers=False,
        manage_ticks=False,
        medianprops={"color": BLACK, "linewidth": 1.2},
        boxprops=line,
        whiskerprops=line,
        capprops=line,
    )
    ax.add_collection(_cloud(values, base=side * 0.5, height=side * 0.6, color=color))


def _cloud(values: Float[np.ndarray, " n"], base: float, height: float, color: str) -> PolyCollection:
    at = np.linspace(values.min(), values.max(), 200)
    if np.ptp(values) == 0:  # no width to estimate a density over
        density = np.ones_like(at)
    else:
        # 2000 values fix the shape of the curve; more would only cost time.
        density = mlab.GaussianKDE(np.random.default_rng(0).permutation(values)[:2000]).evaluate(at)
    edge = base + height * density / density.max()
    outline = np.column_stack([np.r_[at, at[::-1]], np.r_[edge, np.full_like(at, base)]])
    return PolyCollection([outline], facecolor=color, edgecolor=color, alpha=0.6, linewidth=0.6)
