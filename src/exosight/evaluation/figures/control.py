"""The closed loop: what was asked, what the finger felt, what the camera said, what the controller did."""

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
from exosight.evaluation.published import TRAINING_LIMIT

_COLORS = (BLUE, VERMILION, GREEN)


@runtime_checkable
class ControlTrace(Protocol):
    """One run of the loop, a number a step."""

    @property
    def time(self) -> Float[np.ndarray, " steps"]:
        """[s]"""
        ...

    @property
    def target(self) -> Float[np.ndarray, " steps"]:
        """F_t [N]."""
        ...

    @property
    def F_net_true(self) -> Float[np.ndarray, " steps"]:
        """Of the simulation [N]."""
        ...

    @property
    def F_net_estimated(self) -> Float[np.ndarray, " steps"]:
        """From the image [N]."""
        ...

    @property
    def u(self) -> Float[np.ndarray, " steps"]:
        """Actuation [N]."""
        ...


@styled
def steady_states(traces: Sequence[ControlTrace]) -> Figure:
    """F_net, true and estimated, and u for several constant targets; 4 N is the training limit (Fig. 9)."""
    figure = new_figure(height=3.8, width=5.5)
    force, actuation = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    for number, trace in enumerate(traces):
        color = _COLORS[number % len(_COLORS)]
        force.plot(trace.time, trace.target, color=GRAY, linewidth=0.8, linestyle="--")
        force.plot(trace.time, trace.F_net_true, color=color)
        force.plot(trace.time, trace.F_net_estimated, color=color, linestyle=":", linewidth=1.8)
        actuation.plot(trace.time, trace.u, color=color, label=f"target {trace.target[-1]:.2f} N")
    force.set_ylabel("F_net [N]")
    _finish_actuation(actuation)
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
    """F_net, error and actuation of the step response, a line a gain K_P (Fig. 10).

    traces  K_P [N/N] → run of the loop
    """
    figure = new_figure(height=5.0, width=5.5)
    force, error, actuation = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 2))
    for number, (gain, trace) in enumerate(traces.items()):
        # The largest gain swings most, so it lies at the back.
        style = {"color": _COLORS[number % len(_COLORS)], "zorder": 3 - 0.1 * number, "linewidth": 1.0}
        force.plot(trace.time, trace.F_net_true, **style)
        force.plot(trace.time, trace.F_net_estimated, **style | {"linestyle": ":", "linewidth": 1.8})
        error.plot(trace.time, trace.target - trace.F_net_estimated, **style)
        actuation.plot(trace.time, trace.u, **style, label=f"K_P = {gain:g}")
    first = next(iter(traces.values()))
    dashed = {"color": GRAY, "linestyle": "--", "linewidth": 0.9, "zorder": 4}
    force.plot(first.time, first.target, drawstyle="steps-post", **dashed)
    force.set_ylabel("F_net [N]")
    error.set_ylabel("error e [N]")
    _finish_actuation(actuation)
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


def _finish_actuation(ax: Axes) -> None:
    ax.axhline(TRAINING_LIMIT, color=BLACK, linestyle=":", linewidth=0.9)
    ax.annotate(
        f"training data end at {TRAINING_LIMIT:g} N",
        (1, TRAINING_LIMIT),
        xycoords=("axes fraction", "data"),
        xytext=(-2, 2),
        textcoords="offset points",
        ha="right",
        fontsize=7,
    )
    ax.set(ylabel="actuation u [N]", xlabel="time [s]")
