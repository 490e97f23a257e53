"""Figures of the closed loop: trials of one controller, and randomised episodes of several controllers."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from exosight.control import Record, Trial
from exosight.control.stress.measures import RELEASE_SECONDS
from exosight.evaluation.figures.style import (
    BLACK,
    BLUE,
    GRAY,
    GREEN,
    PURPLE,
    VERMILION,
    legend_above,
    new_figure,
    styled,
)

_COLORS = (BLUE, VERMILION, GREEN)
_LINES = ((BLUE, "-"), (VERMILION, "--"), (GREEN, "-."), (PURPLE, ":"))


def trial_figures(trials: Sequence[Trial]) -> dict[str, Figure]:
    """Constant targets in one figure, step responses in one for each target, a line a law; by file name."""
    constant = [trial.record for trial in trials if not trial.released]
    drawn = {"steady_states": steady_states(constant)} if constant else {}
    steps: dict[float, dict[str, Record]] = {}
    for trial in trials:
        if trial.released:
            steps.setdefault(float(trial.record.target[0]), {})[trial.law] = trial.record
    for target, by_law in steps.items():
        name = "step_responses" if len(steps) == 1 else f"step_responses_{target:g}"
        drawn[name] = step_responses(by_law)
    return drawn


@styled
def steady_states(records: Sequence[Record]) -> Figure:
    """The sensor, true and estimated, and the command for several constant targets (Fig. 9)."""
    figure = new_figure(height=3.8, width=5.5)
    force, actuation = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    first = records[0]
    unit = first.controlled.unit
    for number, record in enumerate(records):
        color = _COLORS[number % len(_COLORS)]
        force.plot(record.time, record.target, color=GRAY, linewidth=0.8, linestyle="--")
        force.plot(record.time, record.true, color=color)
        force.plot(record.time, record.estimated, color=color, linestyle=":", linewidth=1.8)
        actuation.plot(
            record.time, record.command, color=color, label=f"target {record.target[-1]:.2f} {unit}"
        )
    force.set_ylabel(f"{first.sensor} [{unit}]")
    _finish_actuation(actuation, first)
    actuation.legend(loc="lower right")
    for ax in (force, actuation):
        ax.grid(axis="y")
    keys = [
        Line2D([], [], color=BLACK),
        Line2D([], [], color=BLACK, linestyle=":", linewidth=1.8),
        Line2D([], [], color=GRAY, linestyle="--", linewidth=0.8),
    ]
    legend_above(figure, keys, ["true", "estimated from the image", "target"])
    return figure


@styled
def step_responses(records: Mapping[str, Record]) -> Figure:
    """The sensor, error and command of the step response, a line a law (Fig. 10).

    records  law, such as "K_P = 5" → run of the loop
    """
    figure = new_figure(height=5.0, width=5.5)
    force, error, actuation = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 2))
    for number, (law, record) in enumerate(records.items()):
        # The largest gain swings most, so it lies at the back.
        style = {"color": _COLORS[number % len(_COLORS)], "zorder": 3 - 0.1 * number, "linewidth": 1.0}
        force.plot(record.time, record.true, **style)
        force.plot(record.time, record.estimated, **style | {"linestyle": ":", "linewidth": 1.8})
        error.plot(record.time, record.error, **style)
        actuation.plot(record.time, record.command, **style, label=law or record.channel)
    first = next(iter(records.values()))
    dashed = {"color": GRAY, "linestyle": "--", "linewidth": 0.9, "zorder": 4}
    force.plot(first.time, first.target, drawstyle="steps-post", **dashed)
    unit = first.controlled.unit
    force.set_ylabel(f"{first.sensor} [{unit}]")
    error.set_ylabel(f"error e [{unit}]")
    _finish_actuation(actuation, first)
    for ax in (force, error, actuation):
        ax.grid(axis="y")
    handles, labels = actuation.get_legend_handles_labels()
    handles += [
        Line2D([], [], color=BLACK),
        Line2D([], [], color=BLACK, linestyle=":", linewidth=1.8),
        Line2D([], [], **dashed),
    ]
    legend_above(figure, handles, [*labels, "true", "estimated", "target"])
    return figure


def _finish_actuation(ax: Axes, record: Record) -> None:
    channel = record.driven
    ax.axhline(channel.peak, color=BLACK, linestyle=":", linewidth=0.9)
    ax.annotate(
        f"training data end at {channel.peak:g} {channel.unit}",
        (1, channel.peak),
        xycoords=("axes fraction", "data"),
        xytext=(-2, 2),
        textcoords="offset points",
        ha="right",
        fontsize=7,
    )
    ax.set(ylabel=f"command {channel.name} [{channel.unit}]", xlabel="time [s]")


@styled
def stress_figure(found: Mapping[str, Any]) -> Figure:
    """The share of episodes up to each value, a panel a quantity, a line a controller.

    A line ends below 100 % where something never happened, and leaves the panel where it is off the axis.

    found   as `exosight.app.stress.results` gives it
    """
    limit = found["about"]["contact_limit"]
    quantities = (  # label, field, limit, end of the axis
        ("steps to settle at a constant target [-]", "settling_steps", None, 25.0),
        ("overshoot of a constant target [%]", "overshoot_percent", None, 100.0),
        ("largest force on one contact [N]", "largest_contact", limit, 3 * (limit or 0.5)),
        ("time from the target's drop to release [s]", "release_seconds", RELEASE_SECONDS, 1.5),
    )
    figure = new_figure(height=4.4)
    panels = figure.subplots(2, 2)
    lines = {}
    for ax, (label, field, limit, largest) in zip(panels.flat, quantities, strict=True):
        for (name, summary), (colour, dash) in zip(found["controllers"].items(), _LINES, strict=False):
            # What 0, 1 … 100 % of the episodes do not exceed; None becomes NaN.
            values = np.array(summary["percentiles"][field], dtype=float)
            share = np.arange(101)[~np.isnan(values)]
            ends = np.append(values[~np.isnan(values)], np.inf).clip(max=2 * largest)
            shares = np.append(share, share[-1:] if len(share) else [0])
            (lines[name],) = ax.step(ends, shares, where="post", color=colour, linestyle=dash)
        if limit is not None:
            ax.axvline(limit, color=BLACK, linewidth=0.8, linestyle=(0, (1, 2)))
        ax.set(xlabel=label, xlim=(0, largest), ylim=(0, 102))
        ax.grid()
    for row in panels:
        row[0].set_ylabel("share of episodes [%]")
    legend_above(figure, list(lines.values()), list(lines))
    return figure
