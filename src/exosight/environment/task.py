"""The task of an agent: bring a sensor F to a target F_t, without pressing too hard anywhere.

Ten times a second the agent changes the command of every channel by a share a of what it can do in a step,

    u_k = clip(u_{k−1} + a_k · rate · period, u_min, u_max),    −1 ≤ a ≤ 1,

the system comes to rest under u_k, and the agent is paid

    r_k = −( |F_t,k − F_k| + w Σ_i max(F_i − F_max,i, 0) ) / 0.1,    i over the estimated sensors:

0 at best, −1 for an error of 0.1 of the sensor's unit. An episode is a row of targets, each held for a while;
it is always cut after the same number of steps, and never ends by itself.
"""

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from gymnasium import spaces
from jaxtyping import Bool, Float, Float32, UInt8
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as configuration

from exosight.control.batch import BatchPlant
from exosight.control.tuning import default_limits, default_rate
from exosight.errors import InputError
from exosight.mechanics.equilibrium import SolverOptions
from exosight.system.camera import Camera
from exosight.system.schema import Schema
from exosight.system.system import System
from exosight.validation import first_fault

REWARD_UNIT = 0.1
"""Error of the controlled sensor that costs 1 [its unit]."""

LARGEST_FORCE = 50.0
"""Bound of the readings that are observed [each in its unit]."""

Count = Annotated[int, Field(ge=1, le=100_000)]
Newtons = Annotated[float, Field(gt=0, le=LARGEST_FORCE)]


@configuration(frozen=True, config=ConfigDict(extra="forbid"))
class GripConfig:
    """Observations, actions and targets of an agent."""

    observation: Literal["state", "image", "mixed"] = "state"
    """Readings and commands; the picture and commands; or both. The target is always part of it."""
    sensor: str | None = None
    """That is to reach its target; by default the one that the system's schema names."""
    steps: Count = 100
    """Of an episode."""
    hold: Count = 25
    """Steps for which a target is held."""
    smallest_target: Newtons = 0.10
    """F_t is drawn evenly from here … [the sensor's unit]"""
    largest_target: Newtons = 0.35
    """… to here [the sensor's unit]."""
    release: Annotated[float, Field(ge=0, le=1)] = 0.2
    """Share of the targets that are 0 instead: release."""
    contact_limit: Newtons | None = None
    """Force on any one contact that must not be passed, F_max [N]; by default the sensors' own, or 0.5 N."""
    excess_weight: Annotated[float, Field(ge=0, le=1000)] = 5.0
    """Cost of what is beyond it in error of the controlled sensor, w [-]."""
    u_min: Annotated[float, Field(le=0, allow_inf_nan=False)] | None = None
    """Smallest command of a single channel [its unit]; by default as far from 0 as a quarter of its peak."""
    u_max: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Largest command of a single channel [its unit]; by default its peak."""
    rate: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Largest change of the command of a single channel a second [its unit/s]; by default the channel's own,
    or its peak in 0.4 s."""
    period: Annotated[float, Field(gt=0, le=10)] = 0.1
    """Of a step [s]."""
    camera: Camera | None = None
    """That the pictures are taken with; by default the system's first one."""

    def __post_init__(self) -> None:
        if not self.smallest_target <= self.largest_target:
            raise InputError("grip: expected a smallest target not above the largest, got the reverse")


_SOLVER = SolverOptions(tolerance=1e-7)
"""Forces to seven digits."""

_SETTINGS = TypeAdapter(GripConfig)


def settings(values: dict[str, Any]) -> GripConfig:
    """Keyword arguments as a configuration; InputError with one sentence for what does not fit."""
    try:
        return _SETTINGS.validate_python(values)
    except ValidationError as error:
        raise InputError(f"grip, {first_fault(error)}") from None


Commands = Float[np.ndarray, " channels"]


def command_ranges(schema: Schema, config: GripConfig) -> tuple[Commands, Commands, Commands]:
    """Smallest and largest command, and largest change in a step, of each channel [its unit].

    They follow from the channels, and from the configuration where there is a single one.

    Raises InputError for numbers beyond the channel's range, or given for several channels.
    """
    given = {name: getattr(config, name) for name in ("u_min", "u_max", "rate")}
    named = [name for name, value in given.items() if value is not None]
    if named and len(schema.channels) > 1:
        raise InputError(
            f"grip, {named[0]}: {schema.system} has {len(schema.channels)} channels; change their "
            "ranges and rates in its description"
        )
    low, high, step = [], [], []
    for channel in schema.channels:
        back = -math.copysign(abs(channel.peak) / 4, channel.peak)
        ends = sorted((max(channel.low, min(channel.high, back)), channel.peak))
        for name, place in (("u_min", 0), ("u_max", 1)):
            value = given[name]
            if value is not None and not channel.low <= value <= channel.high:
                raise InputError(
                    f"grip, {name}: expected {channel.low:g}…{channel.high:g} {channel.unit}, got {value}"
                )
            ends[place] = ends[place] if value is None else value
        low.append(ends[0])
        high.append(ends[1])
        step.append((given["rate"] or default_rate(channel)) * config.period)
    return np.array(low), np.array(high), np.array(step)


def observation_space(schema: Schema, config: GripConfig, camera: Camera) -> spaces.Space:
    """Observations of one agent.

    state   (1 + channels + outputs,)  target F_t, commands, and true readings of the estimated sensors
    command (1 + channels,)            target F_t and commands: what is known without a sensor
    image   (height, width, 1)         gray 0…255

    `state` alone; a dictionary of `image` and `command`; or one of `image` and `state`.
    """
    (lowest, highest, _), known = command_ranges(schema, config), 1 + len(schema.channels)
    floor = [0.0 if "force" in spec.quantity else -LARGEST_FORCE for spec in schema.estimated]
    target = 0.0 if "force" in schema.sensor(config.sensor or schema.controlled).quantity else -LARGEST_FORCE
    low = np.array([target, *lowest, *floor], np.float32)
    high = np.array([LARGEST_FORCE, *highest, *[LARGEST_FORCE] * len(floor)], np.float32)
    state = spaces.Box(low, high)
    if config.observation == "state":
        return state
    image = spaces.Box(0, 255, (camera.height, camera.width, 1), np.uint8)
    if config.observation == "image":
        return spaces.Dict({"image": image, "command": spaces.Box(low[:known], high[:known])})
    return spaces.Dict({"image": image, "state": state})


def action_space(schema: Schema) -> spaces.Box:
    """a: of each channel, the share of the largest change of its command."""
    return spaces.Box(-1.0, 1.0, (len(schema.channels),), np.float32)


class Grips:
    """Several grips side by side, each with its system, its targets, its place in its episode.

    Raises InputError or ConvergenceError as `BatchPlant`.
    """

    def __init__(self, systems: Sequence[System], config: GripConfig) -> None:
        self.config, self.schema = config, systems[0].schema
        self.sensor = config.sensor or self.schema.controlled
        self.schema.index(self.sensor)
        self.camera = config.camera or systems[0].camera
        self._low, self._high, self._largest_change = command_ranges(self.schema, config)
        self._limits = default_limits(self.schema, config.contact_limit)
        self._plant = BatchPlant(systems, _SOLVER)
        self._targets = np.zeros((len(systems), config.steps + 1))
        self._step = np.zeros(len(systems), int)
        self._commands = np.zeros((len(systems), len(self.schema.channels)))

    def __len__(self) -> int:
        return len(self._plant)

    def reset(
        self, generators: Sequence[np.random.Generator | None], target: float | Sequence[float] | None = None
    ) -> None:
        """Begin a new episode wherever there is a generator, at rest, with targets that it draws.

        target  F_t for all of these episodes instead: one number, or one a step (the last goes on) [the
                sensor's unit]

        Raises InputError for targets that are negative or no finite numbers.
        """
        chosen = np.array([generator is not None for generator in generators])
        for i, generator in enumerate(generators):
            if generator is not None:
                self._targets[i] = self._drawn(generator) if target is None else self._given(target)
        self._plant.reset(chosen)
        self._step[chosen] = 0
        self._commands[chosen] = 0.0

    def step(
        self, actions: np.ndarray, still: Bool[np.ndarray, " grips"]
    ) -> tuple[Float[np.ndarray, " grips"], Bool[np.ndarray, " grips"]]:
        """Actuate every grip; the rewards, and whether its episode is over.

        actions   (grips, channels)  a, clipped to ±1
        still     (grips,)           those that have just begun an episode, and do not act in this step

        Raises InputError for actions of another shape or that are no finite numbers.
        """
        actions = np.asarray(actions, float)
        if actions.shape != self._commands.shape or not np.isfinite(actions).all():
            raise InputError(f"actions: expected finite numbers within ±1, shape {self._commands.shape}")
        change = np.where(still[:, None], 0.0, np.clip(actions, -1, 1) * self._largest_change)
        state = self._plant.step(np.clip(self._commands + change, self._low, self._high))
        self._commands = state.commands.copy()
        error = np.abs(self.targets - state.reading(self.sensor))
        excess = np.maximum(state.outputs - self._limits, 0).sum(axis=1)
        self._step[~still] += 1
        reward = -(error + self.config.excess_weight * excess) / REWARD_UNIT
        return np.where(still, 0.0, reward), self._step >= self.config.steps

    @property
    def targets(self) -> Float[np.ndarray, " grips"]:
        """F_t of the coming step [the sensor's unit]."""
        return self._targets[np.arange(len(self)), self._step]

    def observe(self) -> Float32[np.ndarray, "grips seen"] | dict[str, np.ndarray]:
        """What the agents see, as in `observation_space`, one row each."""
        outputs = np.clip(self._plant.state.outputs, -LARGEST_FORCE, LARGEST_FORCE)
        state = np.column_stack([self.targets, self._commands, outputs]).astype(np.float32)
        if self.config.observation == "state":
            return state
        image = self.pictures()[..., None]
        if self.config.observation == "image":
            return {"image": image, "command": state[:, : 1 + self._commands.shape[1]]}
        return {"image": image, "state": state}

    def pictures(self) -> UInt8[np.ndarray, "grips height width"]:
        """Images of the camera."""
        return self._plant.pictures(self.camera)

    @property
    def info(self) -> dict[str, np.ndarray]:
        """For Gymnasium's info: the controlled sensor and every channel's command by their names, each in its
        unit, and whether the solver found the pose that was asked for.
        """
        state = self._plant.state
        commands = {c.name: state.commands[:, i].copy() for i, c in enumerate(self.schema.channels)}
        return {self.sensor: state.reading(self.sensor), **commands, "converged": state.converged.copy()}

    def _drawn(self, generator: np.random.Generator) -> np.ndarray:
        config = self.config
        count = -(-(config.steps + 1) // config.hold)
        forces = generator.uniform(config.smallest_target, config.largest_target, count)
        forces[generator.random(count) < config.release] = 0.0
        return np.repeat(forces, config.hold)[: config.steps + 1]

    def _given(self, target: float | Sequence[float]) -> np.ndarray:
        given = np.atleast_1d(np.asarray(target, float))
        if given.ndim != 1 or not len(given) or not ((given >= 0) & (given <= LARGEST_FORCE)).all():
            raise InputError(f"target: expected numbers within 0…{LARGEST_FORCE:g}, one or one a step")
        return given[np.minimum(np.arange(self.config.steps + 1), len(given) - 1)]
