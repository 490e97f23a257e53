"""The closed loop: target, true and estimated reading of the sensor, and command of the channel."""

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from exosight.evaluation.figures.style import (
    BLACK,
    BLUE,
    GRAY,
    GREEN,
    VERMILION,
    legend_above,
    new_figure,
    styled,
)
from exosight.system.schema import Channel, Schema

_COLORS = (BLUE, VERMILION, GREEN)


@runtime_checkable
class ControlTrace(Protocol):
    """One run of the loop, a number a step."""

    @property
    def schema(self) -> Schema:
        """Of the plant."""
        ...

    @property
    def sensor(self) -> str:
        """Name of the sensor that follows the target."""
        ...

    @property
    def channel(self) -> str:
        """Name of the channel that is driven."""
        ...

    @property
    def time(self) -> Float[np.ndarray, " steps"]:
        """[s]"""
        ...

    @property
    def target(self) -> Float[np.ndarray, " steps"]:
        """Of the sensor [its unit]."""
        ...

    @property
    def true(self) -> Float[np.ndarray, " steps"]:
        """Of the simulation [the sensor's unit]."""
        ...

    @property
    def estimated(self) -> Float[np.ndarray, " steps"]:
        """From the image [the sensor's unit]."""
        ...

    @property
    def command(self) -> Float[np.ndarray, " steps"]:
        """[the channel's unit]"""
        ...


@styled
def steady_states(traces: Sequence[ControlTrace]) -> Figure:
    """The sensor, true and estimated, and the command for several constant targets (Fig. 9)."""
    figure = new_figure(height=3.8, width=5.5)
    force, actuation = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    first = traces[0]
    unit = first.schema.sensor(first.sensor).unit
    for number, trace in enumerate(traces):
        color = _COLORS[number % len(_COLORS)]
        force.plot(trace.time, trace.target, color=GRAY, linewidth=0.8, linestyle="--")
        force.plot(trace.time, trace.true, color=color)
        force.plot(trace.time, trace.estimated, color=color, linestyle=":", linewidth=1.8)
        actuation.plot(trace.time, trace.command, color=color, label=f"target {trace.target[-1]:.2f} {unit}")
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
def step_responses(traces: Mapping[float, ControlTrace]) -> Figure:
    """The sensor, error and command of the step response, a line a gain K_P (Fig. 10).

    traces  K_P [the channel's unit per the sensor's] → run of the loop
    """
    figure = new_figure(height=5.0, width=5.5)
    force, error, actuation = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 2))
    for number, (gain, trace) in enumerate(traces.items()):
        # The largest gain swings most, so it lies at the back.
        style = {"color": _COLORS[number % len(_COLORS)], "zorder": 3 - 0.1 * number, "linewidth": 1.0}
        force.plot(trace.time, trace.true, **style)
        force.plot(trace.time, trace.estimated, **style | {"linestyle": ":", "linewidth": 1.8})
        error.plot(trace.time, trace.target - trace.estimated, **style)
        actuation.plot(trace.time, trace.command, **style, label=f"K_P = {gain:g}")
    first = next(iter(traces.values()))
    dashed = {"color": GRAY, "linestyle": "--", "linewidth": 0.9, "zorder": 4}
    force.plot(first.time, first.target, drawstyle="steps-post", **dashed)
    unit = first.schema.sensor(first.sensor).unit
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


def _finish_actuation(ax: Axes, trace: ControlTrace) -> None:
    channel = _channel(trace)
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


def _channel(trace: ControlTrace) -> Channel:
    return next(channel for channel in trace.schema.channels if channel.name == trace.channel)
