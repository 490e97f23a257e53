"""By how much wearers and moving users scale and shift the force path of `index`, and how the network of the
loop errs: the numbers of `benchmarks.policy_data`.

    python -m benchmarks.policy_users --episodes 64 --seed 5001

Solved plants under the commands of the adaptive controller and of the oracle. The coefficients of the users'
stiffness and flexion are fitted to the first 16 episodes whose users move, scale and shift of the wearer to
each episode. The network, `index-control`, is that of a third run.
"""

import argparse
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.optimize import least_squares

from benchmarks.policy_data import SYSTEM, PathPlants, users
from exosight.control.adaptive import Adaptive
from exosight.control.batch import Plants
from exosight.control.estimator import NAMED_MODELS, OnnxEstimator, Reading
from exosight.control.paths import ControllerConfig
from exosight.control.stress import StressConfig
from exosight.control.stress.episodes import Episode, draw_episode
from exosight.control.stress.frames import Images, camera_sensor, true_sensor
from exosight.control.stress.oracle import run_oracle
from exosight.control.stress.plants import stress_plants
from exosight.control.stress.suite import run_episodes
from exosight.exosuit.catalogue import find_system

_PRESSING = 0.02  # [N]: below it the path is flat
_MOVING = 16  # episodes that the coefficients are fitted to: scale and shift are hardly told apart by more
_LOADED = 0.05  # [N]: from there on the network's errors are shares of the force
_START = (0.3, 0.0, 0.0, 1.0, 0.0)

Samples = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Of one episode: log of the stiffness factor, flexion [rad], u, the controlled sensor, (samples,) each."""


def errors(config: ControllerConfig, users_: np.ndarray, wearer: np.ndarray, samples: Samples) -> np.ndarray:
    """Of the model, as a share of the force."""
    stiffer, flexed, u, force = samples
    s, d = users(stiffer, flexed, wearer[0], wearer[1], users_[:2], users_[2:])
    plants = PathPlants(config, s[:, None], d[:, None])
    return (plants.outputs(0, u) @ config.weights - force) / np.maximum(force, 0.05)


def wearer_of(config: ControllerConfig, users_: np.ndarray, samples: Samples) -> np.ndarray:
    """(σ, δ) of one episode."""
    return least_squares(lambda x: errors(config, users_, x, samples), [0.0, 0.0], max_nfev=8).x


def print_network(episodes: Sequence[Episode], config: ControllerConfig) -> None:
    """Run the episodes with the network as sensor, and print how its estimates are off."""
    sense = camera_sensor(OnnxEstimator.load(NAMED_MODELS["index-control"]))
    seen: list[tuple[np.ndarray, ...]] = []

    def look(plant: Plants, episodes: Sequence[Episode], step: int) -> tuple[Images, Reading]:
        images, read = sense(plant, episodes, step)
        noise = [sum(burst.noise for burst in each.bursts_at(step)) for each in episodes]
        seen.append((np.array(plant.state.outputs), read.forces, read.ood_score > 1, np.array(noise)))
        return images, read

    run_episodes(episodes, [Adaptive(config) for _ in episodes], look, config)
    true, found, refused, noise = map(np.stack, zip(*seen, strict=True))
    force = true.sum(axis=2)
    off = np.log(np.maximum(found.sum(axis=2), 1e-3) / np.maximum(force, 1e-3))
    off = np.where((force > _LOADED) & ~refused, off, np.nan)
    plain = np.where(noise == 0, off, np.nan)
    wearers = np.nanmean(plain, axis=0)
    print("log of estimate over truth: mean, deviation of wearers, of the frames of one", end=" ")
    print(np.round((wearers.mean(), wearers.std(), np.nanstd(plain, axis=0).mean()), 4))
    free = found[(true == 0) & (noise == 0)[..., None] & ~refused[..., None]]
    print(f"where nothing presses: {1e3 * np.sqrt(np.mean(free**2)):.2f} mN (RMS)")
    for low, high in pairwise((1e-3, 3e-3, 1e-2, 3e-2, 1e-1)):
        of_noise = (noise > low) & (noise < high)
        share, spread = refused[of_noise].mean(), np.nanstd((off - wearers)[of_noise])
        print(f"noise {low:g} to {high:g}: {100 * share:.0f} % refused, deviation of the others {spread:.3f}")


def main() -> None:
    """Print the coefficients, the wearers, and how well the model fits."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=64)
    parser.add_argument("--seed", type=int, default=5001)
    asked = parser.parse_args()
    plants = stress_plants(find_system(SYSTEM))
    config = plants.limits
    episodes = [draw_episode(StressConfig(), asked.seed, n, plants) for n in range(asked.episodes)]
    runs = (
        run_episodes(episodes, [Adaptive(config) for _ in episodes], true_sensor, config),
        run_oracle(episodes, config),
    )
    every: list[Samples] = []
    for i, episode in enumerate(episodes):
        stiffer, flexed = np.log(episode.stiffness[:, 0] / episode.stiffness[0, 0]), episode.rest[:, 0]
        columns = np.hstack([(stiffer, flexed, run.command[i], run.true[i]) for run in runs])
        pressing = columns[:, columns[3] > _PRESSING]
        if pressing.shape[1] > 5:
            every.append(tuple(pressing))

    moving = [one for one in every if np.ptp(one[1]) > 0][:_MOVING]

    def moving_errors(users_: np.ndarray) -> np.ndarray:
        return np.concatenate([errors(config, users_, wearer_of(config, users_, one), one) for one in moving])

    found = least_squares(moving_errors, _START, max_nfev=6, diff_step=1e-3).x
    wearers = np.array([wearer_of(config, found, one) for one in every])
    left = np.concatenate(
        [errors(config, found, wearer, one) for wearer, one in zip(wearers, every, strict=True)]
    )
    print("scale by user", np.round(found[:2], 3), "shift by user", np.round(found[2:], 3))
    print("wearers: mean", np.round(wearers.mean(axis=0), 4), "covariance", np.round(np.cov(wearers.T), 4))
    print(f"error of the force: median {100 * np.median(np.abs(left)):.1f} %, RMS {100 * np.std(left):.1f} %")
    print_network(episodes, config)


if __name__ == "__main__":
    main()
