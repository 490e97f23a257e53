"""The grip in the episodes of the stress test, as Gymnasium environments: one, or many solved together.

Plants, users, cameras and frames are those of `exosight.control.stress`: frames are late, lost, noisy or
hidden, the system is not the one that was tuned for, and the user moves. An agent does not drive the plant
itself: ten times a second it corrects the command of the adaptive controller by a share −1 ≤ a ≤ 1 of the
largest correction, as a learned policy does (`exosight.control.learned`), and is paid as in
`exosight.environment.task`.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from jaxtyping import Float
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as configuration

from exosight.control.batch import Plants
from exosight.control.estimator import OnnxEstimator, Reading, model_path
from exosight.control.frame_check import Measurement
from exosight.control.learned import INPUTS, WIDEST, Learned
from exosight.control.stress.config import StressConfig
from exosight.control.stress.episodes import Episode, draw_episode
from exosight.control.stress.frames import FrameDelivery, Images, Look, camera_sensor, true_sensor
from exosight.control.stress.plants import StressPlants, stress_plants
from exosight.control.stress.suite import EpisodeRun
from exosight.environment.task import LARGEST_FORCE, REWARD_UNIT
from exosight.environment.vectors import reseed, row
from exosight.errors import InputError
from exosight.exosuit.catalogue import find_system
from exosight.exosuit.index import NAME
from exosight.validation import first_fault

LARGEST_CORRECTION = 0.2
"""Of the adaptive controller's command, as a share of the channel's peak."""
_KINDS = 30  # of targets, cameras and users, see `draw_episode`: numbers beyond repeat them
_METADATA: dict[str, Any] = {"render_modes": []}


@configuration(frozen=True, config=ConfigDict(extra="forbid"))
class DisturbedConfig(StressConfig):
    """Observations and reward of an agent, and what may go wrong in its episodes."""

    observation: Literal["history", "state", "image", "mixed"] = "history"
    """What the adaptive controller knows, its last frames included; target, command and true readings; the
    last picture that came, with target and command; or picture and history."""
    largest_correction: Annotated[float, Field(gt=0, le=1)] = LARGEST_CORRECTION
    """Of the command, as a share of the channel's peak."""
    excess_weight: Annotated[float, Field(ge=0, le=1000)] = 5.0
    """Cost of what is beyond an output's limit in error of the controlled sensor [-]."""


_SETTINGS = TypeAdapter(DisturbedConfig)


class DisturbedGripVectorEnv(VectorEnv):
    """Many grips under disturbances, solved together; all begin and end their episodes at the same time.

    num_envs        how many
    system          preset or system file, whose variants are worn; or what `stress_plants` made of one
    model           the network in the loop, as `--model` of the command line; None: the true force, with the
                    noise of the episodes
    autoreset_mode  as for `GripVectorEnv`
    others          fields of `DisturbedConfig`

    Raises InputError for settings out of their range, DataError for a network that cannot be read.
    """

    metadata = {**_METADATA, "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012, as Gymnasium has it

    def __init__(
        self,
        num_envs: int = 1,
        system: str | StressPlants = NAME,
        model: str | Path | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **others: Any,
    ) -> None:
        if num_envs < 1:
            raise InputError(f"num_envs: expected at least 1, got {num_envs}")
        try:
            self._config = _SETTINGS.validate_python(others)
        except ValidationError as error:
            raise InputError(f"disturbed grip, {first_fault(error)}") from None
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}
        self.num_envs = num_envs
        self._plants = stress_plants(find_system(system)) if isinstance(system, str) else system
        pictured = self._config.observation in ("image", "mixed")
        self._look = _look(self._plants, model, pictured)
        config = self._plants.limits
        self._controllers = [
            Learned(config, lambda _, i=i: self._actions[i], self._config.largest_correction)
            for i in range(num_envs)
        ]
        self._actions = np.zeros(num_envs)
        self.single_observation_space = self._space()
        self.single_action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators = [seeding.np_random()[0] for _ in range(num_envs)]
        self._step = self._steps = 0
        self._over = False

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict]:
        """Begin an episode of every grip; a seed and the following ones decide them, or one each."""
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, bool)))
        if mask.shape != (self.num_envs,) or not mask.all():
            raise InputError("reset_mask: expected all grips, which end together, got a part of them")
        reseed(self._generators, seed, mask)
        self._begin()
        return self._observe(), self._info()

    def step(self, actions: Any) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict]:
        """One step of every grip; InputError for actions that are no finite numbers, or before `reset`."""
        actions = np.asarray(actions, float)
        if actions.shape != (self.num_envs, 1) or not np.isfinite(actions).all():
            raise InputError(f"actions: expected finite numbers within ±1, shape ({self.num_envs}, 1)")
        none, never = np.zeros(self.num_envs), np.zeros(self.num_envs, bool)
        if not self._steps or (self._over and self._mode is AutoresetMode.DISABLED):
            raise InputError("step: there is no episode, or it is over; reset first")
        if self._over and self._mode is AutoresetMode.NEXT_STEP:
            self._begin()
            return self._observe(), none, never, never.copy(), self._info()
        self._actions = np.clip(actions[:, 0], -1, 1)
        target = self._run.target[:, self._step]
        u = np.array([c.command(float(t)) for c, t in zip(self._controllers, target, strict=True)])
        outputs = self._run.apply(self._step, u)
        rewards = self._paid(outputs, target)
        self._step += 1
        self._take_in()
        self._over = self._step == self._steps
        truncated, info, seen = np.full(self.num_envs, self._over), self._info(), self._observe()
        if self._over and self._mode is AutoresetMode.SAME_STEP:
            final = np.full(self.num_envs, None, dtype=object)
            for i in range(self.num_envs):
                final[i] = row(seen, i)
            all_of_them = np.ones(self.num_envs, bool)
            self._begin()
            seen = self._observe()
            info = {
                **{"final_obs": final, "_final_obs": all_of_them},
                **{"final_info": info, "_final_info": all_of_them.copy()},
                **self._info(),
            }
        return seen, rewards, never, truncated, info

    def _begin(self) -> None:
        """Draw an episode for every grip."""
        config, plants = self._config, self._plants
        episodes = [
            draw_episode(config, int(g.integers(2**31)), int(g.integers(_KINDS)), plants)
            for g in self._generators
        ]
        self._run = EpisodeRun(episodes, plants.limits)
        self._frames = FrameDelivery(episodes, self._look)
        self._step, self._steps, self._over = 1, self._run.steps, False
        height, width = plants.nominal.camera.height, plants.nominal.camera.width
        self._pictures = np.zeros((self.num_envs, height, width, 1), np.uint8)
        for controller in self._controllers:
            controller.reset()
        self._take_in()

    def _take_in(self) -> None:
        """Hand every controller what comes before the coming step."""
        measurements = self._frames.measurements(self._run.plant, self._step - 1)
        for i, (controller, found) in enumerate(zip(self._controllers, measurements, strict=True)):
            controller.observe(found)
            if isinstance(found, Measurement) and np.shape(found.image) == self._pictures.shape[1:3]:
                self._pictures[i, :, :, 0] = found.image

    @property
    def _target(self) -> Float[np.ndarray, " grips"]:
        """Of the coming step; after the last one as before."""
        return self._run.target[:, min(self._step, self._steps - 1)]

    def _space(self) -> spaces.Space:
        """Observations of one agent."""
        config = self._plants.limits
        history = spaces.Box(-WIDEST, WIDEST, (len(INPUTS),), np.float32)
        one = [LARGEST_FORCE] * (2 + len(config.weights))
        state = spaces.Box(-np.array(one, np.float32), np.array(one, np.float32))
        camera = self._plants.nominal.camera
        image = spaces.Box(0, 255, (camera.height, camera.width, 1), np.uint8)
        match self._config.observation:
            case "history":
                return history
            case "state":
                return state
            case "image":
                return spaces.Dict({"image": image, "command": spaces.Box(state.low[:2], state.high[:2])})
            case "mixed":
                return spaces.Dict({"image": image, "history": history})

    def _observe(self) -> Any:
        """What the agents observe, one row each."""
        config, target, state = self._plants.limits, self._target, self._run.plant.state
        kind = self._config.observation
        if kind in ("history", "mixed"):
            pairs = zip(self._controllers, target, strict=True)
            history = np.array([c.inputs(config.reachable(float(t))) for c, t in pairs])
            return history if kind == "history" else {"image": self._pictures.copy(), "history": history}
        u = state.commands[:, config.schema.channel_index(config.channel)]
        known = np.column_stack([target, u, np.clip(state.outputs, -LARGEST_FORCE, LARGEST_FORCE)])
        known = known.astype(np.float32)
        return known if kind == "state" else {"image": self._pictures.copy(), "command": known[:, :2]}

    def _paid(self, outputs: np.ndarray, target: np.ndarray) -> np.ndarray:
        config = self._plants.limits
        error = np.abs(target - outputs @ config.weights)
        excess = np.maximum(outputs - config.output_limits, 0).sum(axis=1)
        return -(error + self._config.excess_weight * excess) / REWARD_UNIT

    def _info(self) -> dict[str, np.ndarray]:
        """Controlled sensor, target and driven command by their names, each in its unit."""
        config, state = self._plants.limits, self._run.plant.state
        found = {
            config.sensor: state.outputs @ config.weights,
            "target": self._target.copy(),
            config.channel: state.commands[:, config.schema.channel_index(config.channel)].copy(),
        }
        return found | {f"_{name}": np.ones(self.num_envs, bool) for name in found}


class DisturbedGripEnv(gymnasium.Env):
    """One grip under disturbances, see `DisturbedGripVectorEnv`, whose arguments it takes."""

    metadata = _METADATA

    def __init__(
        self, system: str | StressPlants = NAME, model: str | Path | None = None, **others: Any
    ) -> None:
        self._one = DisturbedGripVectorEnv(1, system, model, AutoresetMode.DISABLED, **others)
        self.observation_space = self._one.single_observation_space
        self.action_space = self._one.single_action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict]:
        """Begin an episode, which the seed decides."""
        super().reset(seed=seed)
        seen, info = self._one.reset(seed=seed)
        return row(seen, 0), _single(info)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict]:
        """One step; InputError for an action that is no finite number."""
        seen, rewards, _, over, info = self._one.step(np.reshape(action, (1, -1)))
        return row(seen, 0), float(rewards[0]), False, bool(over[0]), _single(info)


def _look(plants: StressPlants, model: str | Path | None, pictured: bool) -> Look:
    """The network, or true readings; these with pictures only where they are observed."""
    if model is not None:
        path = model_path(Path(model), plants.nominal.schema)
        estimator = OnnxEstimator.load(path, history=False)
        estimator.card.check_fits(plants.nominal.schema, "system")
        return camera_sensor(estimator)
    if not pictured:
        return true_sensor
    outputs = len(plants.limits.weights)
    camera = camera_sensor(_NoReader(outputs))

    def sense(plant: Plants, episodes: Sequence[Episode], step: int) -> tuple[Images, Reading]:
        return camera(plant, episodes, step)[0], true_sensor(plant, episodes, step)[1]

    return sense


class _NoReader:
    """Reads nothing off pictures that are only looked at."""

    def __init__(self, outputs: int) -> None:
        self._outputs = outputs

    def read(self, images: np.ndarray, level: float = 0.9) -> Reading:
        """All 0."""
        none = np.zeros((len(images), self._outputs), np.float32)
        return Reading(none, none, none, none, none[:, 0])


def _single(info: dict[str, np.ndarray]) -> dict[str, float]:
    return {name: value[0].item() for name, value in info.items() if not name.startswith("_")}
