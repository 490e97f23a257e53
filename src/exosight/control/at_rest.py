"""A controller that drives nothing: what a guard needs to judge pictures alone (needs JAX)."""

from dataclasses import replace

import numpy as np

from exosight.control.guard import GuardConfig, Guarded
from exosight.control.loop import RATE
from exosight.control.paths import ControllerConfig, ForcePath
from exosight.control.scheduled import Scheduled
from exosight.control.tuning import default_limits, default_rate
from exosight.system.schema import Channel, Schema

UNDRIVEN = Channel("undriven", "N", 0.0, 1.0)
"""Stands in for the channels of a system that has none: a controller has at least one, here always at 0."""


def at_rest(schema: Schema, period: float = 1 / RATE) -> ControllerConfig:
    """Limits by default, and paths on which nothing is sensed.

    period   of a step of the loop [s]
    """
    if not schema.channels:
        schema = replace(schema, channels=(UNDRIVEN,))
    channel, outputs = schema.channels[0], len(schema.outputs)

    def flat(*u: float) -> ForcePath:
        none = np.zeros(len(u))
        return ForcePath(np.array(u), np.zeros((len(u), outputs)), none, none.astype(bool))

    return ControllerConfig(
        schema=schema,
        sensor=schema.controlled,
        channel=channel.name,
        loading=flat(0.0, abs(channel.peak)),
        unloading=flat(abs(channel.peak), 0.0),
        output_limits=default_limits(schema),
        rate=default_rate(channel),
        period=period,
        smallest_gain=1.0,
        largest_gain=1.0,
    )


def observer(schema: Schema, period: float = 1 / RATE, frozen_frames: int = 0) -> Guarded:
    """A guard that judges every frame, and whose command stays 0 while the target is 0.

    frozen_frames   as in GuardConfig

    Of what was measured, how wide an interval is does not count: units and ranges are any.
    """
    guard = GuardConfig(frozen_frames=frozen_frames)
    if schema.measured:
        guard = replace(guard, uncertain_width=_WIDEST)
    return Guarded(Scheduled(at_rest(schema, period)), guard)


_WIDEST = 1e9  # as large as a recording's numbers may be
