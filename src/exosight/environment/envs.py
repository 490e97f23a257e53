"""The grip as Gymnasium environments: one, or many solved together."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from exosight.control.trials import CONTROL_SHAPE
from exosight.environment.task import (
    GripConfig,
    Grips,
    action_space,
    observation_space,
    settings,
)
from exosight.environment.vectors import reseed, row
from exosight.errors import InputError
from exosight.exosuit.catalogue import nominal_system
from exosight.exosuit.published import NAME
from exosight.system.system import System

_METADATA: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}


class GripEnv(gymnasium.Env):
    """One grip, see `exosight.environment.task`.

    system       what is simulated: name of a preset, a system file, or a system itself; by default the
                 exosuit of the paper's controller
    render_mode  "rgb_array": `render` shows the camera's picture
    others       fields of `GripConfig`

    `reset` takes the option "target": F_t [N], one number for the episode or one a step.

    Raises InputError for settings out of their range.
    """

    metadata = _METADATA

    def __init__(self, system: str | System = NAME, render_mode: str | None = None, **others: Any) -> None:
        self.render_mode = _render_mode(render_mode)
        config, systems = _systems((system,), others)
        self._grips = Grips(systems, config)
        self.observation_space = observation_space(self._grips.schema, config, self._grips.camera)
        self.action_space = action_space(self._grips.schema)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict]:
        """Begin an episode at rest; the seed decides its targets."""
        super().reset(seed=seed)
        self._grips.reset([self.np_random], (options or {}).get("target"))
        return self._seen()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict]:
        """One step; InputError for an action that is no finite number."""
        reward, over = self._grips.step(np.reshape(action, (1, -1)), np.zeros(1, bool))
        seen, info = self._seen()
        return seen, float(reward[0]), False, bool(over[0]), info

    def render(self) -> np.ndarray | None:
        """The camera's picture, (height, width, 3)."""
        return _colour(self._grips.pictures())[0] if self.render_mode else None

    def _seen(self) -> tuple[Any, dict]:
        return row(self._grips.observe(), 0), {k: v[0].item() for k, v in self._grips.info.items()}


class GripVectorEnv(VectorEnv):
    """Many grips, solved together: the same as so many `GripEnv`, step by step, but faster.

    num_envs        how many
    system          what is simulated: one for all or several, taken in turn, each as for `GripEnv`; all of
                    one structure
    autoreset_mode  Gymnasium's "NextStep" (an episode that is over begins anew in the next step, whatever the
                    action), "SameStep" (at once; the last observation is in `final_obs`) or "Disabled"
                    (`reset` with the option "reset_mask")
    others          fields of `GripConfig`

    `reset` takes one seed, from which the grips' follow in steps of 1, or one each; and the option "target"
    as `GripEnv` does.

    Raises InputError for settings out of their range.
    """

    metadata = {**_METADATA, "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012, as Gymnasium has it

    def __init__(
        self,
        num_envs: int = 1,
        system: str | System | Sequence[str | System] = NAME,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **others: Any,
    ) -> None:
        if num_envs < 1:
            raise InputError(f"num_envs: expected at least 1, got {num_envs}")
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}
        self.render_mode = _render_mode(render_mode)
        self.num_envs = num_envs
        several = [system] if isinstance(system, str | System) else system
        config, systems = _systems(several, others)
        self._grips = Grips([systems[i % len(systems)] for i in range(num_envs)], config)
        schema = self._grips.schema
        self.single_observation_space = observation_space(schema, config, self._grips.camera)
        self.single_action_space = action_space(schema)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators = [seeding.np_random()[0] for _ in range(num_envs)]
        self._over = np.zeros(num_envs, bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict]:
        """Begin episodes at rest: all, or those of the option "reset_mask"."""
        options = options or {}
        which = np.asarray(options.get("reset_mask", np.ones(self.num_envs, bool)))
        if which.shape != (self.num_envs,) or which.dtype != bool or not which.any():
            raise InputError(f"reset_mask: expected {self.num_envs} booleans, at least one of them true")
        reseed(self._generators, seed, which)
        self._begin(which, options.get("target"))
        return self._grips.observe(), self._info()

    def step(self, actions: Any) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict]:
        """One step of every grip; InputError for actions that are no finite numbers."""
        begun = self._over if self._mode is AutoresetMode.NEXT_STEP else np.zeros(self.num_envs, bool)
        if self._mode is AutoresetMode.DISABLED and self._over.any():
            raise InputError("step: an episode is over; reset it with the option reset_mask first")
        if begun.any():
            self._begin(begun)
        rewards, self._over = self._grips.step(actions, begun)
        truncated, info = self._over.copy(), self._info()
        seen = self._grips.observe()
        if self._mode is AutoresetMode.SAME_STEP and self._over.any():
            last = self._over
            final = np.full(self.num_envs, None, dtype=object)
            for i in np.flatnonzero(last):
                final[i] = row(seen, int(i))
            info = {
                "final_obs": final,
                "_final_obs": last.copy(),
                "final_info": info,
                "_final_info": last.copy(),
            }
            self._begin(last)
            seen = self._grips.observe()
            info |= self._info()
        return seen, rewards, np.zeros(self.num_envs, bool), truncated, info

    def render(self) -> tuple[np.ndarray, ...] | None:
        """The camera's pictures, each (height, width, 3)."""
        return tuple(_colour(self._grips.pictures())) if self.render_mode else None

    def _begin(self, which: np.ndarray, target: Any = None) -> None:
        self._grips.reset(
            [g if own else None for g, own in zip(self._generators, which, strict=True)], target
        )
        self._over = self._over & ~which

    def _info(self) -> dict[str, np.ndarray]:
        info = self._grips.info
        return info | {f"_{name}": np.ones(self.num_envs, bool) for name in info}


def _systems(given: Sequence[str | System], others: dict[str, Any]) -> tuple[GripConfig, list[System]]:
    """The configuration, and the systems: those given, or those of the names given."""
    if not given:
        raise InputError("grip, system: expected at least one, got none")
    return settings(others), [
        one if isinstance(one, System) else nominal_system(one, CONTROL_SHAPE) for one in given
    ]


def _render_mode(mode: str | None) -> str | None:
    if mode not in (None, *_METADATA["render_modes"]):
        raise InputError(f"render_mode: expected rgb_array or none, got {mode!r}")
    return mode


def _colour(images: np.ndarray) -> np.ndarray:
    return np.repeat(images[..., None], 3, axis=-1)
