"""Terms of a user's own: derivatives by exosight, or written by hand. `python -m benchmarks.own_terms`.

The published exosuit with a spring, a magnet or a contact law, each as a `Term` that defines its energy alone
and as one whose `bind` returns the derivatives, as a careful programmer would write them. Both must give the
same numbers. Writes docs/results/own_terms.json; takes two minutes.
"""

import json
from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from benchmarks.timing import LANES, evaluation, in_turns, largest_difference, program
from exosight import lie
from exosight.app.bench import cpu_name
from exosight.exosuit.assembly import ROD, Exosuit, assemble
from exosight.mechanics import Configuration, Equilibria, Robot, Term, drive
from exosight.mechanics.kinematics import Motion
from exosight.mechanics.term import (
    Bound,
    Expansion,
    on_frames,
    point_stiffness,
    point_wrench,
    where_each,
    zero,
)
from exosight.mechanics.tree import Tree

RESULT = Path(__file__).parents[1] / "docs" / "results" / "own_terms.json"
LOADS = np.linspace(0, 2, 9)[1:, None]
"""Of the path whose equilibria are timed [N]."""


class Spring(Term):
    """From the rod's tip to a fixed point, ½ k |p − anchor|²: that of docs/extending.md."""

    stiffness: Float[Array, ""]
    anchor: Float[Array, "3"]

    def frames(self, tree: Tree) -> list[int]:
        """The tip."""
        return [tree.frame(ROD, -1)]

    def energy(self, tree: Tree, at: Configuration, loads: Array) -> Array:
        """[J]"""
        return 0.5 * self.stiffness * jnp.sum((at.position[0] - self.anchor) ** 2)


class SpringByHand(Spring):
    """The same with its derivatives."""

    def bind(self, tree: Tree) -> Bound:
        """Force k (p − anchor) and stiffness k I of a point."""
        frames = np.array(self.frames(tree))

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            p = motion.position[frames]
            force, k = self.stiffness * (p - self.anchor), self.stiffness * jnp.eye(3)[None]
            return zero(tree, loads)._replace(
                energy=0.5 * self.stiffness * jnp.sum((p - self.anchor) ** 2),
                wrench=on_frames(point_wrench(p, force), frames, tree.frames),
                stiffness=on_frames(point_stiffness(p, force, k), frames, tree.frames),
            )

        return expand


class Magnet(Term):
    """A magnet on the rod's tip, of moment u along its axis, and a fixed one of moment M at a place.

    −μ₀/4π (3 (M·r)(u·r)/r⁵ − M·u/r³), r from the fixed one to the tip.

    moment   of the one on the tip [A m²]
    fixed    (3,)  moment of the other [A m²]
    place    (3,)  where that is [m]
    """

    moment: Float[Array, ""]
    fixed: Float[Array, "3"]
    place: Float[Array, "3"]

    def frames(self, tree: Tree) -> list[int]:
        """The tip."""
        return [tree.frame(ROD, -1)]

    def energy(self, tree: Tree, at: Configuration, loads: Array) -> Array:
        """[J]"""
        u, r = self.moment * at.pose[0, :3, 0], at.position[0] - self.place
        far = jnp.sqrt(r @ r)
        return -1e-7 * (3 * (self.fixed @ r) * (u @ r) / far**5 - self.fixed @ u / far**3)


class MagnetByHand(Magnet):
    """The same with its derivatives."""

    def bind(self, tree: Tree) -> Bound:
        """By the twist (ω, v): δp = v + ω × p, δu = ω × u, to second order each."""
        frames = np.array(self.frames(tree))

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            pose, m, one = motion.pose[frames[0]], self.fixed, jnp.eye(3)
            p, u = pose[:3, 3], self.moment * pose[:3, 0]
            r = p - self.place
            near = 1 / (r @ r)
            c = -1e-7 * near * jnp.sqrt(near)  # −μ₀/4π / r³
            a, b, s = m @ r, u @ r, m @ u
            by_u = c * (3 * near * a * r - m)
            mixed = b * m + a * u
            force = 3 * c * near * (mixed + (s - 5 * near * a * b) * r)
            both, along = jnp.outer(m, u), jnp.outer(mixed, r)
            by_p = (both + both.T) - 5 * near * (along + along.T)
            by_p += (35 * near**2 * a * b - 5 * near * s) * jnp.outer(r, r) + (s - 5 * near * a * b) * one
            by_p = 3 * c * near * by_p
            far = jnp.outer(m, r)
            by_pu = 3 * c * near * (far + far.T + a * one - 5 * near * a * jnp.outer(r, r))
            move, turn = -lie.hat(p), -lie.hat(u)
            spin = 0.5 * (jnp.outer(by_u, u) + jnp.outer(u, by_u)) - (by_u @ u) * one
            cross = by_pu @ turn
            corner = spin + move.T @ cross + cross.T @ move
            upper = jnp.concatenate([corner, cross.T], axis=1)
            lower = jnp.concatenate([cross, jnp.zeros((3, 3))], axis=1)
            torque = jnp.concatenate([jnp.cross(u, by_u), jnp.zeros(3)])
            wrench = point_wrench(p, force) + torque
            stiffness = point_stiffness(p[None], force[None], by_p[None])[0]
            stiffness += jnp.concatenate([upper, lower], axis=0)
            return zero(tree, loads)._replace(
                energy=c * (3 * near * a * b - s),
                wrench=on_frames(wrench[None], frames, tree.frames),
                stiffness=on_frames(stiffness[None], frames, tree.frames),
            )

        return expand


class Table(Term):
    """Hertz's contact of spheres at the rod's points with a horizontal plane: ⅖ k Σ max(d, 0)^(5/2).

    stiffness  k [N/m^(3/2)]
    radius     (points,)  [m]
    height     of the plane, which presses upwards [m]
    """

    stiffness: Float[Array, ""]
    radius: Float[Array, " points"]
    height: Float[Array, ""]

    def frames(self, tree: Tree) -> list[int]:
        """All points of the rod."""
        return list(range(*tree.frame_slice(ROD).indices(tree.frames)))

    def depth(self, position: Float[Array, "points 3"]) -> Float[Array, " points"]:
        """Of each point in the plane [m], 0 where it does not touch."""
        return jnp.maximum(self.radius + self.height - position[:, 2], 0.0)

    def energy(self, tree: Tree, at: Configuration, loads: Array) -> Array:
        """[J]"""
        depth = self.depth(at.position)
        touches = depth > 0  # the square root has no derivative at 0
        return (
            0.4
            * self.stiffness
            * jnp.sum(where_each(touches, depth**2 * jnp.sqrt(jnp.where(touches, depth, 1.0))))
        )


class TableByHand(Table):
    """The same with its derivatives."""

    def bind(self, tree: Tree) -> Bound:
        """Force −k d^(3/2) and stiffness 3/2 k d^(1/2) along z."""
        frames, up = np.array(self.frames(tree)), np.array([0.0, 0.0, 1.0])

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            p = motion.position[frames]
            depth = self.depth(p)
            touches = depth > 0
            root = jnp.sqrt(jnp.where(touches, depth, 1.0))
            force = -self.stiffness * (depth * root)[:, None] * up
            k = 1.5 * self.stiffness * root[:, None, None] * np.outer(up, up)
            wrench = where_each(touches, point_wrench(p, force))
            stiffness = where_each(touches, point_stiffness(p, force, k))
            return zero(tree, loads)._replace(
                energy=0.4 * self.stiffness * jnp.sum(where_each(touches, depth**2 * root)),
                wrench=on_frames(wrench, frames, tree.frames),
                stiffness=on_frames(stiffness, frames, tree.frames),
            )

        return expand


def pairs(exosuit: Robot) -> dict[str, tuple[Term, Term]]:
    """Each term with derivatives by exosight, and by hand."""
    surface = np.asarray(exosuit[ROD].section.radius)
    spring = jnp.array(0.5), jnp.array([0.1, 0.0, 0.05])
    magnet = jnp.array(0.1), jnp.array([0.1, 0.0, 0.3]), jnp.array([0.13, 0.01, 0.0])
    table = jnp.array(2e4), jnp.asarray(surface), jnp.array(0.012)
    return {
        "spring": (Spring(*spring), SpringByHand(*spring)),
        "magnet": (Magnet(*magnet), MagnetByHand(*magnet)),
        "contact law": (Table(*table), TableByHand(*table)),
    }


def main() -> None:
    """Both ways of each term in turns, and the exosuit without."""
    exosuit = assemble(Exosuit())
    q = 0.9 * np.asarray(drive([exosuit], LOADS).q)[0]
    rows = []
    for name, (term, by_hand) in pairs(exosuit).items():
        robots = {
            "automatic": Robot(exosuit.bodies, (*exosuit.terms, term)),
            "by hand": Robot(exosuit.bodies, (*exosuit.terms, by_hand)),
        }
        runs = {way: evaluation(robot, True, q, LOADS) for way, robot in robots.items()}
        without = evaluation(exosuit, True, q, LOADS)
        paths = {f"path, {way}": _path(robot) for way, robot in robots.items()}
        spent = in_turns({**runs, "without": without, **paths}, repeats=25)
        found = {way: run() for way, run in runs.items()}
        solved = {way: run() for way, run in paths.items()}
        poses = [np.asarray(solved[f"path, {way}"].q) for way in robots]
        rows.append(
            {
                "term": name,
                "frames": len(term.frames(exosuit)),
                "words": {way: _words(robot) for way, robot in robots.items()},
                "evaluation [us]": {way: 1e6 * spent[way] / LANES for way in (*robots, "without")},
                "ratio": spent["automatic"] / spent["by hand"],
                "equilibrium [us]": {
                    way: 1e6 * spent[f"path, {way}"] / poses[0].shape[1] / LANES for way in robots
                },
                "ratio of equilibria": spent["path, automatic"] / spent["path, by hand"],
                "difference": _difference(found["automatic"], found["by hand"], without()),
                "difference of poses": largest_difference([poses[0]], [poses[1]]),
            }
        )
        print(json.dumps(rows[-1]), flush=True)
    RESULT.write_text(json.dumps({"cpu": cpu_name(), "rows": rows}, indent=1) + "\n")


def _difference(ours: list[np.ndarray], theirs: list[np.ndarray], without: list[np.ndarray]) -> float:
    """Between two results, relative to what the term changes of each kind."""
    kinds = [[np.asarray(x) for x in kind] for kind in zip(ours, theirs, without, strict=True)]
    changes = [(np.abs(a - b).max(), np.abs(b - c).max()) for a, b, c in kinds]
    return max(float(apart / change) for apart, change in changes if change > 0)


def _path(robot: Robot) -> Callable[[], Equilibria]:
    """The equilibria of as many robots as there are lanes."""
    return lambda: drive([robot] * LANES, LOADS)


def _words(robot: Robot) -> int:
    """Length of its program."""
    made = program(robot)
    return sum(len(stage.code) for stage in made.stages) if made else 0


if __name__ == "__main__":
    main()
