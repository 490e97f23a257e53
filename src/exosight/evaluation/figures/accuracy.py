"""Estimated against true sensors on frames the estimator has not learned from."""

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
    grid,
    legend_above,
    new_figure,
    panel_name,
    styled,
)
from exosight.evaluation.metrics import score
from exosight.evaluation.naming import common_unit, sums, with_sums
from exosight.system.schema import Schema, SensorSpec

Values = Float[np.ndarray, "frames outputs"]
"""What the estimated sensors of a schema read, true or estimated [their units]."""

# A contact that happens to be free in all samples must not blow up the estimator's noise [N].
_SMALLEST_SCALE = 0.05


def _panels(schema: Schema) -> list[SensorSpec]:
    """One a panel: the outputs, then their sums."""
    return [schema.sensor(name) for name in (*schema.outputs, *sums(schema))]


def _quantity(schema: Schema) -> str:
    """What is drawn, with its unit if there is one for all: "force [N]"."""
    unit = common_unit(schema)
    forces = all("force" in sensor.quantity for sensor in schema.estimated)
    return f"{'force' if forces else 'value'} [{unit}]" if unit else "value [in the unit of the panel]"


@styled
def sample_traces(
    schema: Schema, true: Values, estimated: Values, samples: int = 60, seed: int = 0
) -> Figure:
    """True and estimated value of every output, and of their sums, for a random set of frames (Fig. 6)."""
    chosen = np.random.default_rng(seed).permutation(len(true))[:samples]
    truth, answer = with_sums(schema, true)[chosen], with_sums(schema, estimated)[chosen]
    number = np.arange(1, len(chosen) + 1)
    sensors = _panels(schema)
    rows = -(-len(sensors) // 2)
    figure = new_figure(height=0.2 + 1.3 * max(rows, 2))
    # Down the first column, then down the second.
    places = [2 * (i % rows) + i // rows for i in range(len(sensors))]
    panels = grid(figure, max(places) + 1, 2, sharex=True)
    handles: list[Line2D] = []
    for ax, sensor, t, e in zip((panels[p] for p in places), sensors, truth.T, answer.T, strict=True):
        ax.vlines(number, t, e, color=GRAY, linewidth=0.6)
        handles = [
            *ax.plot(number, t, "o", color=TRUE, markersize=3.6, markerfacecolor="none", markeredgewidth=0.8),
            *ax.plot(number, e, ".", color=ESTIMATED, markersize=3.6),
        ]
        ax.set_ylabel(f"{panel_name(sensor.name)} [{sensor.unit}]")
        if "force" in sensor.quantity:
            ax.set_ylim(top=max(ax.get_ylim()[1], _SMALLEST_SCALE))
        ax.yaxis.set_major_locator(few_ticks())
        ax.grid(axis="y")
        place = ax.get_subplotspec()
        if place is not None and place.is_last_row():
            ax.set_xlabel("sample (random frames) [-]")
    figure.align_ylabels()
    legend_above(figure, handles, ["true", "estimated"])
    return figure


@styled
def predicted_against_true(schema: Schema, true: Values, estimated: Values) -> Figure:
    """Density of estimated over true value with the identity line, r and RMSE, a panel an output (Fig. 7)."""
    scores = score(schema, true, estimated)
    found = (*scores.outputs, *scores.sums)
    figure = new_figure(height=0.1 + 2.0 * -(-len(found) // 4))
    panels = grid(figure, len(found), 4)
    cells = []
    sensors = [schema.sensor(metrics.name) for metrics in found]
    for ax, metrics, sensor, t, e in zip(
        panels, found, sensors, with_sums(schema, true).T, with_sums(schema, estimated).T, strict=True
    ):
        smallest = _SMALLEST_SCALE if "force" in sensor.quantity else 1e-6
        low, high = min(0.0, t.min(), e.min()), max(t.max(), e.max(), smallest)
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
        ax.set_title(f"{panel_name(metrics.name)}: r = {r}\nRMSE {metrics.rmse:.3f} {metrics.unit}")
    largest = max((float(c.get_array().max()) for c in cells if len(c.get_array())), default=1.0)
    norm = LogNorm(1, max(largest, 10.0))
    for hexagons in cells:
        hexagons.set_norm(norm)
    figure.colorbar(cells[0], ax=panels, label="frames in a cell [-]", pad=0.01, aspect=40, shrink=0.8)
    figure.supxlabel(f"true {_quantity(schema)}", fontsize=8)
    figure.supylabel(f"estimated {_quantity(schema)}", fontsize=8)
    return figure


@styled
def rainclouds(schema: Schema, true: Values, estimated: Values, seed: int = 0) -> Figure:
    """Distributions of outputs: estimated above, true below; cloud, box and points (Fig. 7).

    Most frames leave most contacts free, so clouds of all frames would be one spike at 0 N; of forces only
    the frames whose true force reaches TOUCHING are drawn; each panel says how many of all frames these are.
    """
    sensors = _panels(schema)
    truth, answer = with_sums(schema, true), with_sums(schema, estimated)
    rng = np.random.default_rng(seed)
    figure = new_figure(height=0.2 + 1.8 * -(-len(sensors) // 4))
    for ax, sensor, t, e in zip(grid(figure, len(sensors), 4), sensors, truth.T, answer.T, strict=True):
        is_force = "force" in sensor.quantity
        shown: Bool[np.ndarray, " frames"] = t >= TOUCHING if is_force else np.ones(len(t), dtype=bool)
        ax.axhline(0, color=GRAY, linewidth=0.5)
        if shown.any():
            _half_raincloud(ax, e[shown], side=1.0, color=ESTIMATED, rng=rng)
            _half_raincloud(ax, t[shown], side=-1.0, color=TRUE, rng=rng)
        ax.set(ylim=(-1.2, 1.2), yticks=[])
        ax.spines["left"].set_visible(False)
        ax.xaxis.set_major_locator(few_ticks())
        share = f"touching in {100 * shown.mean():.0f} %" if is_force else f"[{sensor.unit}]"
        ax.set_title(f"{panel_name(sensor.name)}: {share}")
    figure.supxlabel(_quantity(schema), fontsize=8)
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
