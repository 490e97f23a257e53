"""The bound of what any controller reaches: one that knows plant and user and feels the force at once."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Int

from exosight.control.paths import ControllerConfig
from exosight.control.scheduled import RELEASED
from exosight.control.stress.episodes import Episode
from exosight.control.stress.suite import EpisodeRun, Traces
from exosight.control.valve import AT_ONCE

_TRIALS = 8
_CLOSE = 5e-3  # of the target: a tenth of the band


def run_oracle(
    episodes: Sequence[Episode],
    config: ControllerConfig,
    done: Callable[[int, int], None] = lambda step, steps: None,
    seen: Int[np.ndarray, "episodes steps"] | None = None,
) -> Traces:
    """Every episode with the best command of each step, all from rest, within amplitude and rate.

    seen   the step as in which it takes the user to be in each, as `frames.last_seen`; by default that one

    In each step, with the user as he is in it, the command is the root of reading − target by secants, tried
    out on the plant itself; one at which an output passes its limit is lowered. Which targets settle so is
    what is attainable. Its actuators answer at once. It does not look ahead, and where the plant snaps it
    may pass a branch that another order of commands keeps.

    Raises InputError for no episodes, or episodes of several lengths.
    """
    run = EpisodeRun(episodes, config, [AT_ONCE] * len(episodes))
    u = np.zeros(len(episodes))
    slope = np.full(len(episodes), _usual_slope(config))
    for step in range(1, run.steps):
        low, high = np.maximum(u - config.step, config.u_min), np.minimum(u + config.step, config.u_max)
        users = np.full(len(u), step) if seen is None else seen[:, step]
        u, slope = _root(run, step, u, slope, (low, high), config, users)
        if seen is not None:
            run.apply(step, u)
        run.keep(u)
        done(step, run.steps - 1)
    return run.traces(np.full(run.target.shape, np.nan), [()] * len(episodes))


def _root(
    run: EpisodeRun,
    step: int,
    u: Float[np.ndarray, " episodes"],
    slope: Float[np.ndarray, " episodes"],
    within: tuple[Float[np.ndarray, " episodes"], Float[np.ndarray, " episodes"]],
    config: ControllerConfig,
    users: Int[np.ndarray, " episodes"],
) -> tuple[Float[np.ndarray, " episodes"], Float[np.ndarray, " episodes"]]:
    """The best command of a step for users as in others, and the slope of the reading there."""
    goal = run.target[:, step]
    released = np.clip(0.0, *within)
    missing = _missing(run.apply(step, u, users), goal, config)
    for _ in range(_TRIALS):
        wanted = np.where(goal < RELEASED, released, np.clip(u + missing / slope, *within))
        moved = np.abs(wanted - u) > _CLOSE * goal / slope
        if not moved.any():
            break
        before, u = u, np.where(moved, wanted, u)
        now = _missing(run.apply(step, u, users), goal, config)
        change = np.where(moved, (missing - now) / np.where(moved, u - before, 1.0), slope)
        slope = np.clip(change, 1 / config.largest_gain, 0.5 / config.smallest_gain)
        missing = now
    return u, slope


def _missing(
    outputs: Float[np.ndarray, "episodes outputs"],
    goal: Float[np.ndarray, " episodes"],
    config: ControllerConfig,
) -> Float[np.ndarray, " episodes"]:
    """What the controlled sensor lacks, or the output next to its limit where that is less [N or rad]."""
    return np.minimum(goal - outputs @ config.weights, (config.output_limits - outputs).min(axis=1))


def _usual_slope(config: ControllerConfig) -> float:
    slopes = config.loading.slopes @ config.weights
    return float(np.median(slopes[slopes > 1 / config.largest_gain]))
