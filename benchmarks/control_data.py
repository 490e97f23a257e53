"""Pictures of a loop under stress, for the network of the loop to learn from: other wearers, users who move,
cameras that are displaced; commands that wander over their range.

    python -m benchmarks.control_data FOLDER --episodes 2048 --seed 1000

With `--suites 1 2` every other 64 episodes have the friction and the creep of the second suite.

writes `frames.npz` with pictures, readings of all sensors, commands and the number of the episode.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from exosight.control.batch import Joints
from exosight.control.paths import ControllerConfig
from exosight.control.stress import StressConfig
from exosight.control.stress.episodes import Episode, draw_episode
from exosight.control.stress.plants import stress_plants
from exosight.control.stress.suite import solved
from exosight.exosuit.catalogue import find_system
from exosight.exosuit.published import PublishedDesigns
from exosight.system.camera import Camera

_TOGETHER = 64
_KNOT = 5  # steps from one level of u to the next


def wandering(rng: np.random.Generator, steps: int, limits: ControllerConfig) -> np.ndarray:
    """u from one random level to the next, within the rate, from rest."""
    knots = np.arange(0, steps + _KNOT, _KNOT)
    levels = rng.uniform(-0.3, limits.u_max, len(knots))
    levels[0] = 0.0
    wanted, u = np.interp(np.arange(steps), knots, levels), [0.0]
    for goal in wanted[1:]:
        u.append(u[-1] + float(np.clip(goal - u[-1], -limits.step, limits.step)))
    return np.array(u)


def displaced(camera: Camera, rng: np.random.Generator) -> Camera:
    """The camera up to 2 mm off, and up to 3 % too near or too far."""
    x, z, scale = rng.uniform(-1, 1, 3).tolist()
    return replace(
        camera,
        centre=(camera.centre[0] + 0.002 * x, camera.centre[1] + 0.002 * z),
        metres_per_pixel=camera.metres_per_pixel * (1 + 0.03 * scale),
    )


def frames(episodes: list[Episode], limits: ControllerConfig, seed: int) -> dict[str, np.ndarray]:
    """Of every step of the episodes: picture, readings, u."""
    plant = solved(episodes)
    steps = len(episodes[0].target)
    rngs = [np.random.default_rng([seed, number]) for number in range(len(episodes))]
    u = np.stack([wandering(rng, steps, limits) for rng in rngs])
    cameras = [
        displaced(episode.camera, rng) if rng.random() < 0.6 else episode.camera
        for episode, rng in zip(episodes, rngs, strict=True)
    ]
    images, readings, kept = [], [], []
    for step in range(steps):
        joints = Joints(*(np.stack([getattr(e, n)[step] for e in episodes]) for n in ("stiffness", "rest")))
        state = plant.step(limits.commands(u[:, step]), joints)
        images.append(np.concatenate([plant.pictures(c, np.array([i])) for i, c in enumerate(cameras)]))
        readings.append(state.readings)
        kept.append(state.converged)
    whole = np.stack(kept)
    episode = np.tile(np.arange(len(episodes)), (steps, 1))
    return {
        "images": np.stack(images)[whole],
        "readings": np.stack(readings)[whole].astype(np.float32),
        "commands": u.T[whole][:, None].astype(np.float32),
        "episode": episode[whole],
    }


def main() -> None:
    """Simulate and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--episodes", type=int, default=2048)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--suites", type=int, nargs="+", choices=(1, 2), default=(1,))
    asked = parser.parse_args()
    designs = find_system("index")
    assert isinstance(designs, PublishedDesigns)
    plants = stress_plants(designs)
    parts = []
    for start in range(0, asked.episodes, _TOGETHER):
        # The user moves in episodes of even numbers.
        numbers = range(start, min(start + _TOGETHER, asked.episodes))
        suite = asked.suites[start // _TOGETHER % len(asked.suites)]
        config = StressConfig(suite=suite, bursts=0)
        episodes = [draw_episode(config, asked.seed, 2 * number, plants) for number in numbers]
        part = frames(episodes, plants.limits, asked.seed + start)
        parts.append({**part, "episode": part["episode"] + start})
        print(start + len(episodes), sum(len(p["images"]) for p in parts), flush=True)
    asked.folder.mkdir(parents=True, exist_ok=True)
    images, readings, commands, episode = (
        np.concatenate([part[name] for part in parts])
        for name in ("images", "readings", "commands", "episode")
    )
    np.savez_compressed(
        asked.folder / "frames.npz", images=images, readings=readings, commands=commands, episode=episode
    )


if __name__ == "__main__":
    main()
