"""Books of energy on exosuits of `index-friction`: the actuator's work against what is stored and lost.

0 → 4 → 0 N in steps of several sizes, on exosuits with and without snaps. Writes docs/results/balance.json.

    python -m benchmarks.balance
"""

import argparse
import json
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float

from benchmarks.surfaces import LOADS, Driven, driven
from exosight.exosuit.index import index, index_friction
from exosight.exosuit.scenarios import sample_shapes
from exosight.mechanics import Robot, potential, stack
from exosight.mechanics.friction import Held
from exosight.system.system import System

RESULT = Path(__file__).parent.parent / "docs" / "results" / "balance.json"

SHAPES = 0, 2, 3, 4, 14, 21
"""Of the two exosuits of each scenario, seed 0; half of them snap."""
PARTS = 1, 4, 16, 32
"""Into how many parts each step of 0.08 N is divided."""


def lost(history: tuple[np.ndarray, ...]) -> np.ndarray:
    """Work that friction has taken so far, of (..., points, 12) numbers remembered: (...) [J]."""
    (memory,) = history
    points = Held.of(memory.reshape(-1, memory.shape[-1])).dissipated
    return points.reshape(memory.shape[:-1]).sum(axis=-1)


@jax.jit
def _ways(robots: Robot, q: Float[np.ndarray, "shapes poses dofs"]) -> jax.Array:
    """How far the actuators have moved at each pose [m]: Π falls by u times that."""

    def one(robot: Robot, pose: jax.Array) -> jax.Array:
        return potential(robot)(pose, np.zeros(1))[0].energy - potential(robot)(pose, np.ones(1))[0].energy

    return jax.vmap(lambda robot, path: jax.lax.map(lambda pose: one(robot, pose), path))(robots, q)


def works(smooth: list[System], run: Driven, path: Float[np.ndarray, "loads 1"]) -> np.ndarray:
    """Work of each exosuit's actuator on the whole path [J]: ∫ u dw, with the poses on both sides of a snap.

    smooth   the exosuits without friction, which w does not depend on
    """
    poses, loads = [], []
    for q, snaps in zip(np.asarray(run.found.q), run.snaps, strict=True):
        own_q, own_u = [], []
        for k, (pose, load) in enumerate(zip(q, path[:, 0], strict=True)):
            for snap in (snap for snap in snaps if snap.step == k):
                own_q += [snap.before, snap.after]
                own_u += [snap.load[0]] * 2
            own_q.append(pose)
            own_u.append(load)
        poses.append(own_q)
        loads.append(own_u)
    longest = max(map(len, loads))
    u = np.array([own + own[-1:] * (longest - len(own)) for own in loads])
    q = np.array([own + own[-1:] * (longest - len(own)) for own in poses])
    way = np.asarray(_ways(stack([system.robot for system in smooth]), q))
    return (0.5 * (u[:, 1:] + u[:, :-1]) * np.diff(way, axis=1)).sum(axis=1)


def balance(smooth: list[System], rough: list[System], parts: int) -> dict:
    """One size of steps.

    Where points begin to touch or to slip within a step, its work by the trapezoidal rule and its friction
    are of second order.
    """
    number = np.arange(parts * (len(LOADS) - 1) + 1) / parts
    path = np.interp(number, np.arange(len(LOADS)), LOADS[:, 0])[:, None]
    run = driven(rough, path)
    energy, work = np.asarray(run.found.energy), works(smooth, run, path)
    taken = lost(tuple(np.asarray(memory) for memory in run.found.history))
    jumps = [[snap.energy - snap.taken for snap in snaps] for snaps in run.snaps]
    in_snaps, friction = np.array([sum(own) for own in jumps]), taken[:, -1] - taken[:, 0]
    off = np.abs(work - (energy[:, -1] - energy[:, 0]) - friction - in_snaps) / work
    calm = np.array([not own for own in jumps])
    return {
        "step [N]": round(float(path[1, 0]), 6),
        "loads": int(run.found.converged.size),
        "loads that converge": int(run.found.converged.sum()),
        "snaps": sum(map(len, jumps)),
        "work [mJ]": round(1e3 * float(work.sum()), 4),
        "lost to friction [mJ]": round(1e3 * float(friction.sum()), 4),
        "lost in snaps [mJ]": round(1e3 * float(in_snaps.sum()), 4),
        "least lost in a snap [mJ]": 1e3 * float(min(min(own, default=np.inf) for own in jumps)),
        "least lost to friction in a step [mJ]": 1e3 * float(np.diff(taken, axis=1).min()),
        "paths without a snap": int(calm.sum()),
        "largest difference there, relative": float(off[calm].max(initial=0)),
        "largest difference on paths with snaps, relative": float(off[~calm].max(initial=0)),
    }


def main() -> None:
    """Drive in each size of steps, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=RESULT)
    given = parser.parse_args()
    every = [sample.shape for sample in sample_shapes(2, seed=0)]
    shapes = [every[i] for i in SHAPES]
    smooth, rough = [index(shape) for shape in shapes], [index_friction(shape) for shape in shapes]
    result: dict = {"name": "balance", "shapes": len(shapes), "steps": []}
    for parts in PARTS:
        result["steps"].append(balance(smooth, rough, parts))
        print(json.dumps(result["steps"][-1], indent=1), flush=True)
        given.out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
