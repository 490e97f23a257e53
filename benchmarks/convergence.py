"""How fast errors fall: basis, points along the rod, Newton's method, and what an equilibrium costs.

`python -m benchmarks.convergence` writes docs/results/convergence.json, which docs/validation.md shows.
Nothing here is timed.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from benchmarks.planar import EI, LENGTH, RADIUS, YOUNG
from exosight.exosuit.assembly import MAX_FORCE, Exosuit, assemble
from exosight.exosuit.scenarios import sample_shapes
from exosight.mechanics import (
    Circular,
    DeadForce,
    Gauss,
    Legendre,
    NodalCubic,
    NodalLinear,
    NodalQuadratic,
    Robot,
    Rod,
    SolverOptions,
    State,
    drive,
    potential,
    walk,
)
from exosight.mechanics.basis import Basis
from exosight.mechanics.rod import STRAIGHT, STRAINS

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "convergence.json"

LOADS = (1.0, 2.0, 5.0, 10.0)
"""Tip forces [EI/L²]; under the last the tip rises by 0.81 of the length."""
LOAD = 5.0
FINE = 24
"""Gauss points an element where the basis is to be the only error."""
NODAL = {"nodal linear": NodalLinear, "nodal quadratic": NodalQuadratic, "nodal cubic": NodalCubic}
COUNTS = (1, 2, 4, 8)
PATH = np.concatenate([np.linspace(0, MAX_FORCE, 81), np.linspace(MAX_FORCE, 0, 81)[1:]])
"""The paper's path 0 → 4 → 0 N in steps of 0.05 N."""

# Each runs a few times only, so that optimising it costs more than it saves.
_QUICKLY = {"xla_backend_optimization_level": "0"}
_walk = eqx.filter_jit(walk, compiler_options=_QUICKLY)
_evaluate = eqx.filter_jit(lambda robot, q, load: potential(robot)(q, load), compiler_options=_QUICKLY)


def elastica(load: float) -> Float[np.ndarray, "2"]:
    """x/L and z/L of the tip of an inextensible cantilever under a dead force α EI/L² across it.

    √α = K(k) − F(φ₀, k), z/L = 1 − 2 (E(k) − E(φ₀, k)) / √α, x/L = √(2 sin θ / α), with θ the tip's angle,
    2k² = 1 + sin θ, sin φ₀ = 1/(k√2).

    Source: Bisshopp and Drucker, Large deflection of cantilever beams, 1945.
    """

    def parts(angle: float) -> tuple[float, float]:
        return (1 + np.sin(angle)) / 2, np.arcsin(1 / np.sqrt(1 + np.sin(angle)))

    def root_of_load(angle: float) -> float:
        m, start = parts(angle)
        return ellipk(m) - ellipkinc(start, m)

    angle = brentq(lambda a: root_of_load(a) - np.sqrt(load), 1e-9, np.pi / 2 - 1e-9, xtol=1e-15)
    m, start = parts(angle)
    up = 1 - 2 * (ellipe(m) - ellipeinc(start, m)) / np.sqrt(load)
    return np.array([np.sqrt(2 * np.sin(angle) / load), up])


def cantilever(basis: Basis, points: Gauss) -> Robot:
    """A rod that only bends, exactly the elastica, under a dead force of so many EI/L² across its tip."""
    section = Circular(np.full(points.size, RADIUS))
    rod = Rod("rod", LENGTH, section, young=YOUNG, strains={"bend_y": basis}, quadrature=points)
    return Robot((rod,), (DeadForce("rod", -1, 0, EI / LENGTH**2 * jnp.array([0.0, 0.0, 1.0])),))


def tips(basis: Basis, points: Gauss, loads: Sequence[float]) -> Float[np.ndarray, "loads 2"]:
    """x/L and z/L of the tip of a rod that only bends, exactly the elastica, under one load after another."""
    robot = cantilever(basis, points)
    q, found = np.zeros(robot.dofs), []
    for load in loads:
        for _ in range(20):
            here, motion = _evaluate(robot, q, np.array([load]))
            step = np.linalg.solve(here.hessian, -here.gradient)
            q = q + step
            if np.abs(step).max() < 1e-12:
                break
        else:
            raise RuntimeError(f"Newton's method did not end for {basis} under {load} EI/L²")
        np.linalg.cholesky(here.hessian)  # a minimum it is
        found.append(np.asarray(motion.position[-1, ::2]) / LENGTH)
    return np.array(found)


def closed_form() -> dict[str, Any]:
    """Distance of the tip from the elastica's over the length, quadratic elements of 3 Gauss points."""
    exact = np.array([elastica(load) for load in LOADS])
    errors = {
        str(n): np.linalg.norm(tips(NodalQuadratic(n), Gauss(n, 3, element_ends=True), LOADS) - exact, axis=1)
        for n in (5, 10)
    }
    return {
        "loads": LOADS,
        "tip": exact.tolist(),
        "error": {name: error.tolist() for name, error in errors.items()},
    }


def basis_errors() -> dict[str, dict[str, list]]:
    """Error by number of coordinates, with so many points that only the basis counts."""
    exact = elastica(LOAD)

    def error(basis: Basis, points: Gauss) -> float:
        return float(np.linalg.norm(tips(basis, points, [1.0, 2.0, LOAD])[-1] - exact))

    found = {
        name: {
            "coordinates": [family(n).size for n in COUNTS],
            "elements": list(COUNTS),
            "error": [error(family(n), Gauss(n, FINE, element_ends=True)) for n in COUNTS],
        }
        for name, family in NODAL.items()
    }
    degrees = range(9)
    errors = [error(Legendre(degree), Gauss(8, FINE)) for degree in degrees]
    return found | {"Legendre": {"coordinates": [d + 1 for d in degrees], "error": errors}}


SPATIAL = np.random.default_rng(3).normal(size=24) * np.repeat([1.5, 1.5, 1.5, 0.1, 0.1, 0.1], 4)
"""Coordinates of a rod with all six strains, cubic along it: turned by radians, stretched by a tenth."""


def spatial_tip(points: Gauss) -> Float[np.ndarray, "3"]:
    """The tip of the rod of `SPATIAL`, 1 m long."""
    strains = dict.fromkeys(STRAINS, Legendre(3))
    section = Circular(np.full(points.size, RADIUS))
    rod = Rod("rod", 1.0, section, young=YOUNG, strains=strains, quadrature=points)
    return np.asarray(_walk(Robot((rod,)), SPATIAL).position[-1])


def integrated_tip() -> Float[np.ndarray, "3"]:
    """The same from g′ = g ξ̂, by another integrator."""
    basis, q = Legendre(3), SPATIAL.reshape(6, 4)

    def slope(x: float, state: np.ndarray) -> np.ndarray:
        strain = q @ basis.evaluate(np.array([x]))[0] + STRAIGHT
        turn = state[3:].reshape(3, 3)
        a, b, c = strain[:3]
        hat = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
        return np.concatenate([turn @ strain[3:], (turn @ hat).ravel()])

    start = np.concatenate([np.zeros(3), np.eye(3).ravel()])
    return solve_ivp(slope, (0, 1), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:3, -1]


def step_errors() -> dict[str, dict[str, list]]:
    """Error of the tip over the length by number of Magnus steps.

    Of a given spatial strain, against another integrator; of a cantilever at rest, where the same points are
    the quadrature too, against the same basis with very many points. Once with more and more elements of two
    Gauss points, once with more and more points in four elements.
    """
    elements = [Gauss(n, 2, element_ends=True) for n in (2, 4, 8, 16, 32, 64)]
    orders = [Gauss(4, n, element_ends=True) for n in (1, 2, 4, 8, 16, 32)]
    exact = integrated_tip()
    limit = tips(Legendre(3), Gauss(64, 8, element_ends=True), [1.0, 2.0, LOAD])[-1]

    def line(points: Sequence[Gauss], errors: list) -> dict[str, list]:
        return {"steps": [p.size - 1 for p in points], "error": [float(np.linalg.norm(e)) for e in errors]}

    def rests(points: Sequence[Gauss]) -> list[np.ndarray]:
        return [tips(Legendre(3), p, [1.0, 2.0, LOAD])[-1] - limit for p in points]

    return {
        "given strains in space": line(elements, [spatial_tip(p) - exact for p in elements]),
        "at rest, more elements": line(elements, rests(elements)),
        "at rest, more points in each": line(orders, rests(orders)),
    }


def newton_residuals() -> dict[str, list[float]]:
    """The solver's residual after so many iterations, from the equilibrium at one load to that at another."""

    def line(robot: Robot, path: Sequence[float], load: float) -> list[float]:
        start = State(drive([robot], np.array(path)[:, None]).q[:, -1], np.array([[load]]))
        residuals = []
        for most in range(1, 16):
            options = SolverOptions(tolerance=1e-15, max_iterations=most)
            found = drive([robot], np.array([[load]]), state=start, options=options)
            residuals.append(float(found.residual[0, 0]))
            if residuals[-1] < 1e-12:  # round-off is near
                break
        return residuals

    bent = cantilever(NodalQuadratic(4), Gauss(4, 3, element_ends=True))
    worn = assemble(Exosuit())
    return {
        "cantilever, 2 to 2.5 EI/L²": line(bent, [1.0, 2.0], 2.5),
        "exosuit on a finger, 1 to 1.05 N": line(worn, np.linspace(0, 1, 21).tolist(), 1.05),
    }


def iterations(per_scenario: int) -> dict[str, Any]:
    """How many Newton steps an equilibrium takes on the paper's path, so many shapes of each scenario."""
    robots = [assemble(Exosuit(sampled.shape)) for sampled in sample_shapes(per_scenario, seed=0)]
    found = drive(robots, PATH[:, None])
    steps = np.asarray(found.iterations).ravel()
    return {
        "shapes": len(robots),
        "loads": len(PATH),
        "counts": np.bincount(steps).tolist(),
        "mean": float(steps.mean()),
        "median": float(np.median(steps)),
        "converged": float(np.mean(found.converged)),
    }


def orders(x: Sequence[float], y: Sequence[float]) -> list[float]:
    """Order between neighbours: −d log y / d log x."""
    return [float(s) for s in -np.diff(np.log(y)) / np.diff(np.log(x))]


def main() -> None:
    """Compute all numbers anew."""
    found = {
        "elastica": closed_form(),
        "basis": basis_errors(),
        "steps": step_errors(),
        "newton": newton_residuals(),
        "iterations": iterations(10),
    }
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(found, indent=1) + "\n")
    print(json.dumps(found))


if __name__ == "__main__":
    main()
