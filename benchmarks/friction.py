"""Friction on exosuits of `index-friction`: what it costs, what it loses, and whether steps matter.

0 → 4 → 0 N at 101 loads without friction and with μ = 0.3, and the balance of work; the controller's exosuit
in steps of 0.02, 0.1 and 0.5 N. Writes docs/results/friction.json.

    python -m benchmarks.friction [--per-scenario 2]
"""

import argparse
import json
import time
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float

from benchmarks.surfaces import LOADS, Driven, driven, share_apart
from exosight.control import CONTROL_SHAPE
from exosight.exosuit.index import index, index_friction
from exosight.exosuit.scenarios import sample_shapes
from exosight.mechanics import Robot, potential, stack
from exosight.mechanics.friction import Held
from exosight.system.simulation import simulate_path
from exosight.system.system import System

RESULT = Path(__file__).parent.parent / "docs" / "results" / "friction.json"

STEPS = 0.02, 0.1, 0.5
"""[N]; all are compared with the first."""


def described(run: Driven, seconds: float) -> dict:
    """What driving the exosuits took, and how far the ways up and down are apart."""
    found = run.found
    return {
        "share of loads that converge": round(float(found.converged.mean()), 5),
        "exosuits that converge at every load": int(found.converged.all(axis=1).sum()),
        "snaps a path": round(float(np.mean([len(snaps) for snaps in run.snaps])), 2),
        "evaluations a load": round(float(found.iterations.mean()), 2),
        "share of loads with F_net over 5 mN apart": share_apart(run),
        "seconds, compilation included": round(seconds, 1),
    }


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


def works(smooth: list[System], run: Driven) -> np.ndarray:
    """Work of each exosuit's actuator on the whole path [J]: ∫ u dw, with the poses on both sides of a snap.

    smooth   the exosuits without friction, which w does not depend on
    """
    poses, loads = [], []
    for q, snaps in zip(np.asarray(run.found.q), run.snaps, strict=True):
        own_q, own_u = [], []
        for k, (pose, load) in enumerate(zip(q, LOADS[:, 0], strict=True)):
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


def balance(smooth: list[System], run: Driven) -> dict:
    """The actuators' work from 0 to 4 to 0 N, less what is still stored, against what is known to be lost.

    A snap sets energy free, of which friction takes a part on the way down.
    """
    energy, memory = np.asarray(run.found.energy), np.asarray(run.found.history[0])
    spent = works(smooth, run) - (energy[:, -1] - energy[:, 0])
    friction = np.diff(lost((memory[:, [0, -1]],)), axis=1)[:, 0]
    free = np.array([sum(snap.energy for snap in snaps) for snaps in run.snaps])
    calm = np.array([not snaps for snaps in run.snaps])
    return {
        "work less stored energy, all paths [mJ]": round(1e3 * float(spent.sum()), 3),
        "taken by friction, all paths [mJ]": round(1e3 * float(friction.sum()), 3),
        "set free by snaps, all paths [mJ]": round(1e3 * float(free.sum()), 3),
        "paths without a snap": int(calm.sum()),
        "their work less stored energy [mJ]": round(1e3 * float(spent[calm].sum()), 4),
        "taken by friction there [mJ]": round(1e3 * float(friction[calm].sum()), 4),
        "largest difference of the two there, in the larger": round(
            float((np.abs(spent - friction) / np.maximum(spent, friction))[calm].max(initial=0)), 5
        ),
    }


def steps() -> dict:
    """The controller's exosuit: F_net and what is lost, in steps of several sizes."""
    system = index_friction(CONTROL_SHAPE)
    sensor = [each.name for each in system.schema.sensors].index("F_net")
    result: dict = {}
    exact: dict[tuple[float, bool], float] = {}
    for step in STEPS:
        up = np.linspace(0, 4, round(4 / step) + 1)
        way = np.concatenate([up, up[-2::-1]])
        states = simulate_path(system, way[:, None])
        net = states.observation.readings[:, sensor]
        back = np.arange(len(way)) >= len(up)
        forces = {(round(u, 2), down): f for u, down, f in zip(way.tolist(), back.tolist(), net, strict=True)}
        exact = exact or forces
        apart = {at: 1e3 * abs(force - exact[at]) for at, force in forces.items()}
        result[f"{step} N"] = {
            "evaluations a load": round(float(states.equilibria.iterations.mean()), 2),
            "F_net at 2 N, up and down [N]": [round(float(forces[2.0, down]), 4) for down in (False, True)],
            "lost [mJ]": round(1e3 * float(lost(states.equilibria.history)[-1]), 4),
            "largest difference of F_net at multiples of 0.5 N [mN]": round(
                float(max(d for (u, _), d in apart.items() if round(u / 0.5, 6) % 1 == 0)), 3
            ),
            "largest difference of F_net at any load [mN]": round(float(max(apart.values())), 3),
            "loads with a difference over 1 mN": sum(bool(d > 1) for d in apart.values()),
        }
    return result


def main() -> None:
    """Drive without and with friction, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--per-scenario", type=int, default=2)
    parser.add_argument("--out", type=Path, default=RESULT)
    given = parser.parse_args()
    shapes = [sample.shape for sample in sample_shapes(given.per_scenario, seed=0)]
    smooth = [index(shape) for shape in shapes]
    result: dict = {"name": "friction", "shapes": len(shapes), "loads": len(LOADS)}
    for name, systems in (("index", smooth), ("index-friction", [index_friction(s) for s in shapes])):
        began = time.perf_counter()
        run = driven(systems)
        result[name] = described(run, time.perf_counter() - began)
        if run.found.history:
            result["balance of work"] = balance(smooth, run)
        print(json.dumps(result, indent=1), flush=True)
    result["the controller's exosuit in steps of"] = steps()
    given.out.write_text(json.dumps(result, indent=1) + "\n")
    print(json.dumps(result, indent=1), flush=True)


if __name__ == "__main__":
    main()
