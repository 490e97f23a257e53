"""What the evaluations of quasi-static paths are spent on: 110 exosuits, 0 → 4 N at 51 loads.

Takes the driver one evaluation at a time, and counts those of each trial under what the trial came to. Writes
docs/results/evaluations.json after each system.

    python -m benchmarks.evaluations [--shapes 110] [--systems published index index-friction]
"""

import argparse
import json
from collections import Counter
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.equilibria import SYSTEMS
from exosight.arrays import AnyArray
from exosight.exosuit.assembly import MAX_FORCE
from exosight.exosuit.scenarios import sample_shapes
from exosight.mechanics import Robot, SolverOptions, stack
from exosight.mechanics.continuation_state import DESCEND, TO_LOAD, ContinuationState
from exosight.mechanics.metric import Metric
from exosight.mechanics.packing import Packing
from exosight.mechanics.path_step import Carried, begun, layout_of, prepare, program_of, stepper

RESULT = Path(__file__).parent.parent / "docs" / "results" / "evaluations.json"

LOADS = np.linspace(0, MAX_FORCE, 51)[:, None]
TOGETHER = 64
"""Evaluations of every robot between looks at which have come to their last load."""

AT_ONCE, ON_THE_WAY = "loads reached in one trial", "loads reached from a point on the way"
POINTS = "points on the way"
BACK, ALONG_BACK = "trials at a load, taken back", "trials along a branch, taken back or beyond its end"
DESCENTS = "descents"


def told(before: Carried, after: Carried, state: Packing) -> dict[str, AnyArray]:
    """What one evaluation was for, and what came of it."""
    was: ContinuationState = state.unpack(before.row)
    now: ContinuationState = state.unpack(after.row)
    return {
        "meant": before.load < len(LOADS),
        "phase": was.phase,
        "first": was.tries == 0,
        "fresh": was.steps == 0,
        "done": after.load != before.load,
        "arrived": jnp.any(now.anchor.tangent != was.anchor.tangent),
    }


def watched(robots: list[Robot], options: SolverOptions) -> dict[str, np.ndarray]:
    """`told` of every evaluation of every robot, (robots, evaluations)."""
    leaves, structure = jax.tree.flatten(stack(robots))
    leaves = [np.asarray(leaf) for leaf in leaves]
    program = program_of(structure, tuple(leaf.shape[1:] for leaf in leaves), LOADS.shape[1])
    layout = layout_of(robots[0].dofs, LOADS.shape[1], tuple(map(np.shape, robots[0].memories)))

    @jax.jit
    def advance(leaves: list[jax.Array], now: Carried) -> tuple[Carried, dict]:
        def one(leaves: list[jax.Array], now: Carried) -> tuple[Carried, dict]:
            robot = jax.tree.unflatten(structure, leaves)
            step = stepper(
                robot,
                Metric.of(robot),
                program,
                prepare(program, robot),
                jnp.asarray(LOADS),
                jnp.asarray(len(LOADS)),
                jnp.asarray(options.tolerance),
                jnp.asarray(options.max_iterations),
            )

            def watch(now: Carried, _: None) -> tuple[Carried, dict]:
                after = step(now)
                return after, told(now, after, layout.state)

            return jax.lax.scan(watch, now, None, length=TOGETHER)

        return jax.vmap(one)(leaves, now)

    rest = [begun(r.dofs, LOADS.shape[1], r.memories, len(LOADS)) for r in robots]
    now = jax.tree.map(lambda *parts: np.stack(parts), *rest)
    parts = []
    while np.any(np.asarray(now.load) < len(LOADS)):
        now, seen = advance(leaves, now)
        parts.append({name: np.asarray(values) for name, values in seen.items()})
    return {name: np.concatenate([part[name] for part in parts], axis=1) for name in parts[0]}


def counted(seen: dict[str, np.ndarray]) -> dict:
    """Evaluations a load, and trials, under what the trials came to."""
    evaluations: Counter[str] = Counter()
    trials: Counter[str] = Counter()
    for i in range(len(seen["meant"])):
        of = {name: values[i, seen["meant"][i]] for name, values in seen.items()}
        starts = np.flatnonzero(of["first"])
        for start, end in zip(starts, [*starts[1:], len(of["first"])], strict=True):
            last = end - 1
            if of["phase"][last] == DESCEND:
                name = DESCENTS
            elif of["done"][last]:
                name = AT_ONCE if of["fresh"][start] else ON_THE_WAY
            elif of["arrived"][last]:
                name = POINTS
            else:
                name = BACK if of["phase"][last] == TO_LOAD else ALONG_BACK
            evaluations[name] += int(end - start)
            trials[name] += 1
    loads = len(seen["meant"]) * len(LOADS)
    return {
        "evaluations a load": round(sum(evaluations.values()) / loads, 3),
        "of which": {
            name: {"evaluations a load": round(evaluations[name] / loads, 3), "trials": trials[name]}
            for name in (AT_ONCE, ON_THE_WAY, POINTS, BACK, ALONG_BACK, DESCENTS)
        },
    }


def main() -> None:
    """Watch each system, count, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shapes", type=int, default=110)
    parser.add_argument("--systems", nargs="+", choices=SYSTEMS, default=list(SYSTEMS))
    parser.add_argument("--out", type=Path, default=RESULT)
    given = parser.parse_args()
    shapes = [sample.shape for sample in sample_shapes(10, seed=0)]
    shapes = shapes[:: -(-len(shapes) // given.shapes)]
    result: dict = {"name": "evaluations", "shapes": len(shapes), "loads": len(LOADS)}
    for name in given.systems:
        robots = [SYSTEMS[name](shape).robot for shape in shapes]
        result[name] = counted(watched(robots, SolverOptions()))
        given.out.write_text(json.dumps(result, indent=1) + "\n")
        print(json.dumps(result, indent=1), flush=True)


if __name__ == "__main__":
    main()
