"""An agent that learns beside the controller that knows its exosuit, on the same targets.

    pip install 'exosight[gym,agents]'
    python -m benchmarks.agents

PPO of Stable-Baselines3 learns the task of `exosight.environment` from forces and u on many simulated grips
at once, then both are shown targets that it never learned from. Both have a perfect sensor.
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from exosight.app.bench import cpu_name
from exosight.control import CONTROL_SHAPE, Guarded, Measurement, Scheduled
from exosight.control.estimator import Reading
from exosight.control.tuning import tune
from exosight.environment.envs import GripVectorEnv
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import published

GRIPS = 64
EPISODES = 96
STEPS = 100_000
FIRST_SEED = 10_000
"""Of the targets that are judged; learning draws its own from seed 0 on."""

RESULT = Path(__file__).parents[1] / "docs" / "results" / "agents.json"
BAND = 0.05
"""A force counts as on target within this share of it."""

Policy = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""From states (grips, 9) and pictures (grips, height, width, 1) to actions (grips, 1)."""


class ForStableBaselines(VecEnv):
    """Our vector of environments as Stable-Baselines3 expects one."""

    def __init__(self, env: GripVectorEnv) -> None:
        assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
        self._env, self._actions = env, np.zeros((env.num_envs, 1))
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> Any:
        """Begin all episodes."""
        seed = self._seeds[0]
        self._reset_seeds()
        return self._env.reset(seed=seed)[0]

    def step_async(self, actions: np.ndarray) -> None:
        """Take note of the actions."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict]]:
        """Act."""
        seen, rewards, _, over, told = self._env.step(self._actions)
        infos: list[dict] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(over):
            infos[i] = {"terminal_observation": told["final_obs"][i], "TimeLimit.truncated": True}
        return seen, rewards.astype(np.float32), over, infos

    def close(self) -> None:
        """Nothing is open."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute that all share."""
        return [getattr(self._env, attr_name)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not needed."""
        raise NotImplementedError

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Not needed."""
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """It is not."""
        return [False] * self.num_envs


def learn(steps: int) -> tuple[Policy, float]:
    """An agent after so many steps of the environment, and how long they took [s]."""
    torch.set_num_threads(1)
    env = VecNormalize(ForStableBaselines(GripVectorEnv(GRIPS, autoreset_mode="SameStep")), gamma=0.9)
    env.seed(0)
    agent = PPO(
        "MlpPolicy",
        env,
        gamma=0.9,  # a target is worth a second of looking ahead
        n_steps=50,
        batch_size=400,
        n_epochs=5,
        learning_rate=1e-3,
        policy_kwargs={"net_arch": [64, 64], "log_std_init": -1.0},
        seed=0,
        device="cpu",
    )
    started = time.perf_counter()
    agent.learn(steps)
    seconds = time.perf_counter() - started
    env.training = False

    def act(states: np.ndarray, pictures: np.ndarray) -> np.ndarray:
        return agent.predict(env.normalize_obs(states), deterministic=True)[0]

    return act, seconds


def controller(grips: int) -> Policy:
    """The scheduled law behind its guard, one for each grip; its first measurement is of rest."""
    config = tune(published(Exosuit(CONTROL_SHAPE)))
    own = [Guarded(Scheduled(config)) for _ in range(grips)]

    def act(states: np.ndarray, pictures: np.ndarray) -> np.ndarray:
        actions = np.zeros((grips, 1))
        for i, guarded in enumerate(own):
            target, u, forces = float(states[i, 0]), float(states[i, 1]), states[i : i + 1, 2:]
            sure = Reading(forces, forces, forces, (forces > 0).astype(np.float32), np.zeros(1, np.float32))
            wanted = guarded.step(target, Measurement(pictures[i, :, :, 0], sure, commands=np.array([u])))
            actions[i] = (wanted - u) / config.step
        return actions

    return act


def judge(make: Callable[[int], Policy], episodes: int) -> dict[str, float]:
    """What a policy does in so many episodes, all at once."""
    env = GripVectorEnv(episodes, observation="mixed", autoreset_mode="Disabled")
    policy = make(episodes)
    seen, _ = env.reset(seed=FIRST_SEED)
    targets, forces, contacts, rewards = [], [], [], []
    over = np.zeros(episodes, bool)
    while not over.all():
        targets.append(seen["state"][:, 0])
        actions = policy(seen["state"], seen["image"])
        seen, reward, _, over, told = env.step(actions)
        forces.append(told["F_net"])
        contacts.append(seen["state"][:, 2:].max(axis=1))
        rewards.append(reward)
    return measures(*(np.array(part) for part in (targets, forces, contacts, rewards)))


def measures(
    targets: np.ndarray, forces: np.ndarray, contacts: np.ndarray, rewards: np.ndarray
) -> dict[str, float]:
    """Numbers by name; all arguments (steps, episodes)."""
    error = np.abs(targets - forces)
    changes = np.vstack([np.ones_like(targets[:1], bool), targets[1:] != targets[:-1]])
    held: list[tuple[np.ndarray, float]] = []
    over: list[float] = []
    for episode in range(targets.shape[1]):
        begins = np.flatnonzero(changes[:, episode])
        for first, last in zip(begins, [*begins[1:], len(targets)], strict=True):
            if last - first >= 10:
                force, target = forces[first:last, episode], float(targets[first, episode])
                held.append((force, target))
                if target > (forces[first - 1, episode] if first else 0.0):  # on the way down there is none
                    over.append(max(float(force.max() / target) - 1, 0.0))
    pressing = [(force, target) for force, target in held if target > 0]
    released = [force for force, target in held if target == 0]
    late = [np.abs(force[-5:] - target).max() <= BAND * target for force, target in pressing]
    return {
        "reward a step": float(rewards.mean()),
        "mean error [N]": float(error.mean()),
        "on target within 5 % in the last 5 steps of a target [%]": 100 * float(np.mean(late)),
        "median overshoot [%]": 100 * float(np.median(over)),
        "95th percentile of overshoot [%]": 100 * float(np.quantile(over, 0.95)),
        "let go below 0.005 N within 1 s [%]": 100 * float(np.mean([f[9] < 0.005 for f in released])),
        "steps with a contact above its limit [%]": 100 * float(np.mean(contacts > 0.5)),
    }


def run(steps: int = STEPS, episodes: int = EPISODES) -> dict[str, Any]:
    """Learn, judge, and return all numbers."""
    agent, seconds = learn(steps)
    return {
        "name": "agents",
        "cpu": cpu_name(),
        "steps learned": steps,
        "seconds to learn": round(seconds),
        "steps a second while learning": round(steps / seconds),
        "episodes judged": episodes,
        "PPO": judge(lambda _: agent, episodes),
        "scheduled and guarded": judge(controller, episodes),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the numbers to docs/results/agents.json and show them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--episodes", type=int, default=EPISODES)
    parser.add_argument("--out", type=Path, default=RESULT)
    chosen = parser.parse_args(arguments)
    found = json.dumps(run(chosen.steps, chosen.episodes), indent=1, ensure_ascii=False)
    chosen.out.write_text(found + "\n")
    print(found)


if __name__ == "__main__":
    main()
