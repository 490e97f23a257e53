"""What is asked of an agent: press on the finger with F_net = F_t, without pressing too hard anywhere.

Ten times a second the agent changes the actuation by a share a of what the actuator can do in a step,

    u_k = clip(u_{k−1} + a_k · rate · period, u_min, u_max),    −1 ≤ a ≤ 1,

the exosuit comes to rest under u_k, and the agent is paid

    r_k = −( |F_t,k − F_net,k| + w Σ_i max(F_i − F_max, 0) ) / 0.1 N,    i = 1…7:

0 at best, −1 for an error of 0.1 N. An episode is a row of targets, each held for a while; it is always cut
after the same number of steps, and never ends by itself.
"""

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from gymnasium import spaces
from jaxtyping import Bool, Float, Float32, UInt8
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as configuration

from exosight.control.batch import BatchPlant
from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit
from exosight.mechanics.equilibrium import SolverOptions
from exosight.system.camera import Camera

REWARD_UNIT = 0.1
"""Error of F_net that costs 1 [N]."""

LARGEST_FORCE = 50.0
"""Bound of the forces that are observed [N]; no exosuit within its limits comes near it."""

Count = Annotated[int, Field(ge=1, le=100_000)]
Newtons = Annotated[float, Field(gt=0, le=LARGEST_FORCE)]


@configuration(frozen=True, config=ConfigDict(extra="forbid"))
class GripConfig:
    """What an agent sees, what it may do, what it is asked for."""

    observation: Literal["state", "image", "mixed"] = "state"
    """Forces and u; the picture and u; or both. The target is always told."""
    steps: Count = 100
    """Of an episode."""
    hold: Count = 25
    """Steps for which a target is held."""
    smallest_target: Newtons = 0.10
    """F_t is drawn evenly from here … [N]"""
    largest_target: Newtons = 0.35
    """… to here [N]."""
    release: Annotated[float, Field(ge=0, le=1)] = 0.2
    """Share of the targets that are 0 N instead: let go."""
    contact_limit: Newtons = 0.5
    """Force on any one contact that must not be passed, F_max [N]."""
    excess_weight: Annotated[float, Field(ge=0, le=1000)] = 5.0
    """Cost of a newton beyond it in newtons of error, w [-]."""
    u_min: Annotated[float, Field(ge=-6, le=0)] = -1.0
    """Smallest actuation [N]."""
    u_max: Annotated[float, Field(gt=0, le=6)] = 4.0
    """Largest actuation [N]."""
    rate: Annotated[float, Field(gt=0, le=1000)] = 10.0
    """Largest change of u a second [N/s]."""
    period: Annotated[float, Field(gt=0, le=10)] = 0.1
    """Of a step [s]."""
    camera: Camera = Camera()
    """That the pictures are taken with."""

    def __post_init__(self) -> None:
        if not self.smallest_target <= self.largest_target:
            raise InputError("grip: expected a smallest target not above the largest, got the reverse")


# Forces to seven digits; 4 robots wait for the slowest of them, not 8.
_SOLVER = SolverOptions(tolerance=1e-7, lanes=4)

_SETTINGS = TypeAdapter(GripConfig)


def settings(values: dict[str, Any]) -> GripConfig:
    """Keyword arguments as a configuration; InputError with one sentence for what does not fit."""
    try:
        return _SETTINGS.validate_python(values)
    except ValidationError as error:
        fault = error.errors()[0]
        name = ".".join(str(part) for part in fault["loc"])
        raise InputError(f"grip, {name}: {fault['msg']}, got {str(fault['input'])[:80]}") from None


def observation_space(config: GripConfig) -> spaces.Space:
    """What one agent sees.

    state   (9,)  target F_t, u, and the true forces on C1…C7, all in newtons
    order   (2,)  target F_t and u: what one knows without a sensor [N]
    image   (height, width, 1)  gray 0…255

    `state` alone; a dictionary of `image` and `order`; or one of `image` and `state`.
    """
    low = np.array([0.0, config.u_min, *[0.0] * 7], np.float32)
    high = np.array([LARGEST_FORCE, config.u_max, *[LARGEST_FORCE] * 7], np.float32)
    state = spaces.Box(low, high)
    if config.observation == "state":
        return state
    image = spaces.Box(0, 255, (config.camera.height, config.camera.width, 1), np.uint8)
    if config.observation == "image":
        return spaces.Dict({"image": image, "order": spaces.Box(low[:2], high[:2])})
    return spaces.Dict({"image": image, "state": state})


def action_space() -> spaces.Box:
    """a: the share of the largest change of u."""
    return spaces.Box(-1.0, 1.0, (1,), np.float32)


class Grips:
    """Several grips side by side, each with its exosuit, its targets, its place in its episode.

    Raises InputError or ConvergenceError as `BatchPlant`.
    """

    def __init__(self, exosuits: Sequence[Exosuit], config: GripConfig) -> None:
        self.config = config
        limit = max(config.u_max, -config.u_min)
        self._plant = BatchPlant(exosuits, limit, _SOLVER)
        self._targets = np.zeros((len(exosuits), config.steps + 1))
        self._step = np.zeros(len(exosuits), int)
        self._u = np.zeros(len(exosuits))

    def __len__(self) -> int:
        return len(self._plant)

    def reset(
        self, generators: Sequence[np.random.Generator | None], target: float | Sequence[float] | None = None
    ) -> None:
        """Begin a new episode wherever there is a generator, at rest, with targets that it draws.

        target  F_t [N] for all of these episodes instead: one number, or one a step (the last goes on)

        Raises InputError for targets that are negative or no finite numbers.
        """
        chosen = np.array([generator is not None for generator in generators])
        for i, generator in enumerate(generators):
            if generator is not None:
                self._targets[i] = self._drawn(generator) if target is None else self._told(target)
        self._plant.reset(chosen)
        self._step[chosen] = 0
        self._u[chosen] = 0.0

    def step(
        self, actions: np.ndarray, still: Bool[np.ndarray, " grips"]
    ) -> tuple[Float[np.ndarray, " grips"], Bool[np.ndarray, " grips"]]:
        """Actuate every grip; the rewards, and whether its episode is over.

        actions   (grips, 1)  a, clipped to ±1
        still     (grips,)    those that have just begun an episode, and do not act in this step

        Raises InputError for actions of another shape or that are no finite numbers.
        """
        actions, config = np.asarray(actions, float), self.config
        if actions.shape != (len(self), 1) or not np.isfinite(actions).all():
            raise InputError(
                f"actions: expected {len(self)} finite numbers within ±1, shape ({len(self)}, 1)"
            )
        change = np.where(still, 0.0, np.clip(actions[:, 0], -1, 1) * config.rate * config.period)
        state = self._plant.step(np.clip(self._u + change, config.u_min, config.u_max))
        self._u = state.u.copy()
        error = np.abs(self.targets - state.net_force)
        excess = np.maximum(state.forces[:, 1:] - config.contact_limit, 0).sum(axis=1)
        self._step[~still] += 1
        reward = -(error + config.excess_weight * excess) / REWARD_UNIT
        return np.where(still, 0.0, reward), self._step >= config.steps

    @property
    def targets(self) -> Float[np.ndarray, " grips"]:
        """F_t of the coming step [N]."""
        return self._targets[np.arange(len(self)), self._step]

    def observe(self) -> Float32[np.ndarray, "grips 9"] | dict[str, np.ndarray]:
        """What the agents see, as in `observation_space`, one row each."""
        forces = self._plant.state.forces[:, 1:]
        state = np.column_stack([self.targets, self._u, np.minimum(forces, LARGEST_FORCE)]).astype(np.float32)
        if self.config.observation == "state":
            return state
        image = self.pictures()[..., None]
        if self.config.observation == "image":
            return {"image": image, "order": state[:, :2]}
        return {"image": image, "state": state}

    def pictures(self) -> UInt8[np.ndarray, "grips height width"]:
        """What the camera sees."""
        return self._plant.pictures(self.config.camera)

    def tell(self) -> dict[str, np.ndarray]:
        """For the records: F_net and u [N], and whether the solver found the pose that was asked for."""
        state = self._plant.state
        return {"F_net": state.net_force.copy(), "u": state.u.copy(), "converged": state.converged.copy()}

    def _drawn(self, generator: np.random.Generator) -> np.ndarray:
        config = self.config
        count = -(-(config.steps + 1) // config.hold)
        forces = generator.uniform(config.smallest_target, config.largest_target, count)
        forces[generator.random(count) < config.release] = 0.0
        return np.repeat(forces, config.hold)[: config.steps + 1]

    def _told(self, target: float | Sequence[float]) -> np.ndarray:
        told = np.atleast_1d(np.asarray(target, float))
        if told.ndim != 1 or not len(told) or not ((told >= 0) & (told <= LARGEST_FORCE)).all():
            raise InputError(f"target: expected newtons within 0…{LARGEST_FORCE:g}, one or one a step")
        return told[np.minimum(np.arange(self.config.steps + 1), len(told) - 1)]
