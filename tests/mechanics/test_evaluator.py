"""Scalar programs and XLA evaluate the same energy, for robots of every kind, and solve the same paths."""

import platform
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from backends import NEVER, SAME, check
from benchmarks.timing import program

from exosight.exosuit.assembly import Exosuit, assemble
from exosight.mechanics import Configuration, Robot, SolverOptions, Term, drive, stack
from exosight.mechanics.energy import potential
from exosight.mechanics.evaluator import solve_any, solve_definite, solve_signed
from exosight.mechanics.path_step import prepare, program_of
from exosight.scalar_program import Held, call_unrolled, interpreter
from exosight.system.build import build
from exosight.system.file import describe, read_system_file

SYSTEMS = Path(__file__).parents[2] / "examples" / "systems"


def test_published_exosuit() -> None:
    check(assemble(Exosuit()))


def test_everything_at_once_out_of_the_plane(tree: Robot) -> None:
    check(tree)


@pytest.mark.parametrize("last", [2.0, 0.0, -1.0])
def test_only_positive_definite_matrices_are_solved(last: float) -> None:
    """Also without its last pivot alone, which LAPACK refuses and a square root does not."""
    matrix, right = jnp.diag(jnp.array([1.0, 3.0, last])), jnp.ones((3, 2))
    for solve in (partial(call_unrolled, solve_definite), solve_definite):
        found, definite = jax.jit(solve)(matrix, right)
        assert definite == (last > 0)
        if last > 0:
            np.testing.assert_allclose(matrix @ found, right, rtol=1e-15)


def test_chain(chain: Robot) -> None:
    check(chain)


@pytest.mark.parametrize("name", ["thumb", "two_lines", "profile"])
def test_systems_of_files(name: str) -> None:
    """With half of the points along their rods: as much to derive, half as much to compute."""
    values = dict(read_system_file(SYSTEMS / f"{name}.toml"))
    values["rods"] = {rod: {**table, "points_per_element": 4} for rod, table in values["rods"].items()}
    check(build(describe(values)).robot)


class Potential(Term):
    """k Σ p⁴ of all frames, found by repeated multiplication or by a loop that cannot be unrolled."""

    stiffness: jax.Array
    loop: bool = eqx.field(static=True)

    def energy(self, tree: Any, at: Configuration, loads: jax.Array) -> jax.Array:
        p = at.position
        if not self.loop:
            return self.stiffness * jnp.sum(p**4)
        limit = jnp.where(jnp.isfinite(p[0, 0]), 4, 0)
        power = jax.lax.while_loop(
            lambda state: state[0] < limit, lambda state: (state[0] + 1, state[1] * p), (0, jnp.ones_like(p))
        )[1]
        return self.stiffness * jnp.sum(jax.lax.stop_gradient(power) * 0 + p**4)


def test_a_term_of_a_users_own(chain: Robot) -> None:
    """By automatic differentiation of its energy."""
    check(Robot(chain.bodies, (*chain.terms, Potential(jnp.array(30.0), loop=False))))


def test_what_cannot_be_unrolled_is_left_to_xla(chain: Robot, evaluate: Callable) -> None:
    """A term with a loop of unknown length: there is no program, and the same equilibrium is found."""
    robots = [
        Robot(chain.bodies, (*chain.terms, Potential(jnp.array(30.0), loop=loop))) for loop in (False, True)
    ]
    leaves, structure = jax.tree.flatten(robots[1])
    assert program_of(structure, tuple(np.shape(leaf) for leaf in leaves), 1) is None
    found = drive(robots[1:], np.zeros((1, 1)))
    assert found.converged.all()
    at_rest, moved = (evaluate(robots[0], share * found.q[0, 0], np.zeros(1))[0] for share in (1.0, 0.9))
    # In balance by the same energy without the loop: solved to 1e-10 of the pose in the elastic norm.
    assert np.abs(at_rest.gradient).max() < 1e-8 * np.abs(moved.gradient).max()


@pytest.mark.parametrize("skew", [0.0, 1.0])
@pytest.mark.parametrize("lowered", [0.0, 3.0])
def test_solutions_with_the_sign_of_the_determinant(skew: float, lowered: float) -> None:
    """As NumPy has them: a positive definite symmetric part, with and without an eigenvalue made negative."""
    rng = np.random.default_rng(7)
    for _ in range(20):
        spread, turning, v, right = (rng.normal(size=(12, n)) for n in (12, 12, 1, 3))
        matrix = spread @ spread.T / 12 + np.eye(12) + skew * (turning - turning.T)
        matrix -= lowered * np.trace(matrix) / 12 * v @ v.T / (v.T @ v)
        for solved, sign in (
            solve_signed(matrix, right),
            jax.jit(partial(call_unrolled, solve_signed))(matrix, right),
        ):
            assert sign == np.sign(np.linalg.det(matrix))
            bound = 1e-12 * np.linalg.cond(matrix) * np.abs(right).max()
            np.testing.assert_allclose(matrix @ solved, right, rtol=0, atol=bound)


def test_no_sign_without_a_pivot() -> None:
    """A row of zeros has no solution."""
    matrix = np.diag([1.0, 0.0, 2.0])
    assert solve_signed(matrix, np.ones((3, 1)))[1] == 0
    assert jax.jit(partial(call_unrolled, solve_signed))(matrix, np.ones((3, 1)))[1] == 0


def test_any_matrix_is_solved() -> None:
    """With rows exchanged: also with zeros in the place of pivots, as NumPy solves it."""
    rng = np.random.default_rng(8)
    for size in (1, 2, 3, 12):
        matrix, right = rng.normal(size=(size, size)), rng.normal(size=(size, 2))
        matrix[0, 0] = 0.0 if size > 1 else 2.0
        for solve in (solve_any, jax.jit(partial(call_unrolled, solve_any))):
            bound = 1e-13 * np.linalg.cond(matrix) * np.abs(right).max()
            np.testing.assert_allclose(matrix @ solve(matrix, right), right, rtol=0, atol=bound)


def test_paths_are_the_same() -> None:
    """Equilibria and snaps of an exosuit, both ways."""
    robots = [assemble(Exosuit())]
    loads = np.linspace(0, 3, 11)[:, None]
    ours, theirs = (
        drive(robots, loads, options=SolverOptions(unrolled=unrolled)) for unrolled in (True, False)
    )
    assert ours.converged.all()
    np.testing.assert_array_equal(ours.snapped, theirs.snapped)
    np.testing.assert_allclose(ours.q, theirs.q, atol=1e-9 * np.abs(theirs.q).max())


@pytest.fixture(scope="module")
def hessian() -> tuple[Robot, np.ndarray, np.ndarray]:
    """Of an exosuit at one pose, by XLA."""
    robot, q = assemble(Exosuit()), np.random.default_rng(1).normal(size=25) * 0.1
    found, _ = jax.jit(lambda robot, q: potential(robot)(q, jnp.ones(1)))(robot, q)
    return robot, q, np.asarray(found.hessian)


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="names of x86 processors")
@pytest.mark.parametrize(
    ("processor", "features"), [("x86-64", ""), ("haswell", ""), ("x86-64", "+avx,-fma")], ids=str
)
def test_other_processors(
    processor: str, features: str, hessian: tuple, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without AVX, and with AVX2: vectors of eight are cut into what registers hold."""
    flags = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    if processor == "haswell" and not {"avx2", "fma", "bmi2"} <= set(flags.split()):
        pytest.skip("this processor has no AVX2")
    if "+avx" in features and "avx" not in flags.split():
        pytest.skip("this processor has no AVX")
    targets = {bits: f"exosight_{processor}_{features}_{bits}" for bits in (16, 32)}
    interpreter.register(processor, features, targets)
    monkeypatch.setattr(interpreter, "TARGETS", targets)
    robot, q, expected = hessian
    made = program(robot)
    assert made is not None

    def energy(robot: Robot, q: jax.Array) -> jax.Array:
        return made(1, Held.of(prepare(made, robot)), (q, jnp.ones(1), (), NEVER))[0].here.hessian

    batch = stack([robot])
    found = jax.jit(jax.vmap(energy))(batch, q[None])
    np.testing.assert_allclose(found[0], expected, rtol=0, atol=SAME * np.abs(expected).max())
