"""What a learned policy learns from: what the adaptive controller knows, and how far the best command is off.

    python -m benchmarks.policy_data FOLDER --episodes 4000 --seed 5100

writes `FOLDER/rows.npz`. Targets, users, and late, lost, noisy or hidden frames are those of the stress test,
of another seed. The plants are not solved: each is the nominal path F₀(u) of `index`, scaled and shifted,

    F(u) = s F₀((u − d) / s),   log s = σ + a·(log k, φ),   d = δ + b·(log k, φ, φ log k),

with k the factor of the user's joint stiffness, φ his flexion, and (σ, δ) drawn for every wearer. So the best
command, d + s U₀(F_t/s), is known. `python -m benchmarks.policy_users` measures these numbers on 64 episodes
with solved plants, whose F_net the model meets with a median error of 0.6 % (RMS 4 %).

In every second episode the sensor errs as `index-control` does, which `policy_users` measures as well: by a
factor for each wearer, another for each frame, and forces where nothing presses.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from exosight.control.batch import Plants
from exosight.control.estimator import Reading
from exosight.control.learned import Learned
from exosight.control.paths import ControllerConfig
from exosight.control.scheduled import RELEASED
from exosight.control.stress import StressConfig
from exosight.control.stress.episodes import Episode, draw_episode
from exosight.control.stress.frames import FrameDelivery, Images, Look, true_sensor
from exosight.control.stress.plants import StressPlants, stress_plants
from exosight.exosuit.catalogue import find_system

SYSTEM = "index"
LARGEST = 0.2
"""Correction of the command, as a share of the channel's peak."""
SCALE_BY_USER = (0.081, -0.444)
"""a: of log s, per log k and per radian of φ; as b and the wearers measured by `benchmarks.policy_users`."""
SHIFT_BY_USER = (-0.200, 2.076, -0.911)
"""b: of d [N], per log k, per radian of φ, per radian and log k."""
WEARERS = (-0.018, 0.042), ((0.0314, -0.0100), (-0.0100, 0.0275))
"""Mean and covariance of (σ, δ [N])."""
ESTIMATED = 0.013, 0.013, 0.012
"""Of the network's F_net in 96 episodes, the mean of the logarithm of estimate over truth, its deviation
among wearers, and among the frames of one; in 64 of them 0.011, 0.014, 0.012."""
UNPRESSED = 5e-4
"""Estimates where nothing presses [N], RMS."""
NOISY, REFUSED = 0.25, 0.03
"""Of images with noise, the deviation of that logarithm over the noise's, and the variance of the noise from
which on they are out of distribution; images on which something hides the device all are."""
TOGETHER = 200


@dataclass(frozen=True)
class PathPlants:
    """Plants whose force paths are the nominal one, scaled and shifted.

    config   with the nominal path
    s, d     (episodes, steps)   scale [-] and shift [the channel's unit]
    """

    config: ControllerConfig
    s: np.ndarray
    d: np.ndarray

    def outputs(self, step: int, u: np.ndarray) -> np.ndarray:
        """What the estimated sensors read under u, (episodes, outputs)."""
        path, s = self.config.loading, self.s[:, step]
        w = (u - self.d[:, step]) / s
        force, beyond = np.maximum.accumulate(path.controlled), np.maximum(w - path.u[-1], 0)
        found = s[:, None] * np.stack([np.interp(w, path.u, each) for each in path.outputs.T], axis=1)
        return found * (1 + beyond * self._last_slope / force[-1])[:, None]

    def command(self, step: int, target: np.ndarray) -> np.ndarray:
        """u at which the controlled sensor reads the targets, (episodes,)."""
        path, s = self.config.loading, self.s[:, step]
        force, wanted = np.maximum.accumulate(path.controlled), target / s
        beyond = np.maximum(wanted - force[-1], 0) / self._last_slope
        return self.d[:, step] + s * (np.interp(wanted, force, path.u) + beyond)

    @property
    def _last_slope(self) -> float:
        path = self.config.loading
        force = np.maximum.accumulate(path.controlled)
        return float((force[-1] - force[-3]) / (path.u[-1] - path.u[-3]))


def path_plants(episodes: Sequence[Episode], config: ControllerConfig, seed: int) -> PathPlants:
    """A wearer for every episode, who moves as its user does."""
    wearers = np.random.default_rng(seed).multivariate_normal(*WEARERS, size=len(episodes))
    stiffer = np.log([e.stiffness[:, 0] / e.stiffness[0, 0] for e in episodes])
    flexed = np.array([e.rest[:, 0] for e in episodes])  # of the knuckle, whose share of the motion is 1
    s, d = users(stiffer, flexed, wearers[:, :1], wearers[:, 1:])
    return PathPlants(config, s, d)


def users(
    stiffer: np.ndarray,
    flexed: np.ndarray,
    scale: float | np.ndarray,
    shift: float | np.ndarray,
    scale_by: Sequence[float] | np.ndarray = SCALE_BY_USER,
    shift_by: Sequence[float] | np.ndarray = SHIFT_BY_USER,
) -> tuple[np.ndarray, np.ndarray]:
    """s and d of wearers (σ, δ) whose users have log k and φ."""
    s = scale + scale_by[0] * stiffer + scale_by[1] * flexed
    d = shift + shift_by[0] * stiffer + shift_by[1] * flexed + shift_by[2] * stiffer * flexed
    return np.exp(s), d


def sensor(seed: int) -> Look:
    """The true readings, in every second episode as the network would estimate them."""
    random = np.random.default_rng([seed, 1])
    mean, wearer, frame = ESTIMATED
    of_wearers = random.normal(mean, wearer, TOGETHER)

    def look(plant: Plants, episodes: Sequence[Episode], step: int) -> tuple[Images, Reading]:
        images, read = true_sensor(plant, episodes, step)
        forces, ood_score = read.forces.copy(), read.ood_score.copy()
        for i in range(0, len(episodes), 2):
            noise = max((burst.noise for burst in episodes[i].bursts_at(step)), default=0.0)
            ood_score[i] = 2.0 if noise > REFUSED else ood_score[i]
            error = of_wearers[i] + random.normal(0.0, np.hypot(frame, NOISY * np.sqrt(noise)))
            true, nothing = plant.state.outputs[i], np.abs(random.normal(0.0, UNPRESSED, forces.shape[1]))
            forces[i] = np.where(true > 0, true * np.exp(error), nothing)
        return images, replace(read, forces=forces, low=forces, high=forces, ood_score=ood_score)

    return look


def rows(episodes: Sequence[Episode], plants: PathPlants, look: Look) -> dict[str, np.ndarray]:
    """Every step of the episodes in which the best command is within reach, a row each, without corrections.

    returns  `inputs` of a policy; `missing`, what the observer's command lacks [the channel's unit]; `worth`,
             error of the force per error of u, as a share of the target; `episode`
    """
    config = plants.config
    controllers = [Learned(config, lambda _: 0.0, LARGEST) for _ in episodes]
    state = SimpleNamespace(outputs=plants.outputs(0, np.zeros(len(episodes))))
    state.commands = config.commands(np.zeros(len(episodes)))
    plant: Any = SimpleNamespace(state=state)
    frames, u = FrameDelivery(episodes, look), np.zeros(len(episodes))
    found: list[tuple[np.ndarray, float, float, int]] = []
    for step in range(1, episodes[0].drop):
        measurements = frames.measurements(plant, step - 1)
        target = np.array([episode.target[step] for episode in episodes])
        best = plants.command(step, target)
        for i, (controller, measurement) in enumerate(zip(controllers, measurements, strict=True)):
            controller.observe(measurement)
            goal, within = config.reachable(float(target[i])), abs(best[i] - u[i]) <= config.step
            if within and config.u_min <= best[i] <= config.u_max and goal >= RELEASED:
                wanted, slope = controller.aim(goal)
                found.append((controller.inputs(goal), best[i] - wanted, slope / goal, i))
            u[i] = controller.command(float(target[i]))
        state.outputs, state.commands = plants.outputs(step, u), config.commands(u)
    inputs, *others = zip(*found, strict=True)
    names = ("inputs", "missing", "worth", "episode")
    return dict(zip(names, map(np.array, (inputs, *others)), strict=True))


def collect(plants: StressPlants, episodes: int, seed: int) -> dict[str, np.ndarray]:
    """The rows of so many episodes."""
    parts = []
    for first in range(0, episodes, TOGETHER):
        numbers = range(first, min(first + TOGETHER, episodes))
        drawn = [draw_episode(StressConfig(), seed, number, plants) for number in numbers]
        part = rows(drawn, path_plants(drawn, plants.limits, seed + first), sensor(seed + first))
        part["episode"] += first
        parts.append(part)
        print(f"{numbers[-1] + 1} of {episodes} episodes", flush=True)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def main() -> None:
    """Write the rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--episodes", type=int, default=4000)
    parser.add_argument("--seed", type=int, default=5100)
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    found = collect(stress_plants(find_system(SYSTEM)), asked.episodes, asked.seed)
    np.savez_compressed(asked.folder / "rows.npz", **found)


if __name__ == "__main__":
    main()
