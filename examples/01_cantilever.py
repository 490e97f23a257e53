"""A cantilever bent by a dead force at its tip, compared with the elastica.

A straight rod is clamped at its base and loaded by a transverse force P of constant direction at its
tip. For an inextensible, unshearable rod the shape is given exactly by elliptic
integrals and depends on P L²/EI alone (K. E. Bisshopp and D. C. Drucker, Large deflection of cantilever
beams, Quarterly of Applied Mathematics 3, 1945). Here the rod is silicone, 30 cm long and 2 cm thick, with
its curvature on four quadratic elements (nine coordinates).

The figure shows the rod's shapes for P L²/EI = 0…10, and the position of its tip over the load, with the
exact solution. The printed number is the tip's deflection over the length at P L²/EI = 10; the exact value is
0.810609.
"""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from exosight.mechanics import Circular, DeadForce, Gauss, NodalQuadratic, Robot, Rod, drive, walk

LENGTH, RADIUS, YOUNG = 0.3, 0.01, 1e6
BLUE, ORANGE, GRAY = "#0072B2", "#E69F00", "#999999"


def cantilever(elements: int) -> Robot:
    points = Gauss(elements, 8, element_ends=True)
    rod = Rod(
        "rod",
        LENGTH,
        Circular(jnp.full(points.size, RADIUS)),
        young=YOUNG,
        strains={"bend_y": NodalQuadratic(elements)},
        quadrature=points,
    )
    return Robot((rod,), (DeadForce("rod", -1, 0, jnp.array([0.0, 0.0, 1.0])),))


def elastica(alpha: float) -> tuple[float, float]:
    """x/L and z/L of the exact tip under P = α EI/L²."""

    def parts(theta: float) -> tuple[float, float]:
        m = (1 + np.sin(theta)) / 2
        return m, np.arcsin(1 / np.sqrt(2 * m))

    def excess(theta: float) -> float:
        m, phi = parts(theta)
        return ellipk(m) - ellipkinc(phi, m) - np.sqrt(alpha)

    theta = brentq(excess, 1e-9, np.pi / 2 - 1e-12, xtol=1e-15)
    m, phi = parts(theta)
    return np.sqrt(2 * np.sin(theta) / alpha), 1 - 2 / np.sqrt(alpha) * (ellipe(m) - ellipeinc(phi, m))


def main(folder: Path = Path("results/01_cantilever")) -> float:
    alpha = np.linspace(0.0, 10.0, 11)
    robot = cantilever(elements=4)
    stiffness = YOUNG * np.pi * RADIUS**4 / 4
    found = drive([robot], alpha[:, None] * stiffness / LENGTH**2)
    poses = eqx.filter_jit(jax.vmap(lambda q: walk(robot, q).pose))(found.q[0])
    shapes = np.asarray(poses[:, :, [0, 2], 3]) / LENGTH  # (loads, points, 2)

    figure = Figure(figsize=(7.0, 3.2), layout="constrained")
    bent, over_load = figure.subplots(1, 2)
    loads = np.linspace(0.01, 10, 200)
    exact = np.array([elastica(a) for a in loads])
    bent.plot(*exact.T, color=GRAY, linewidth=3, label="tip, elastica")
    for shape in shapes:
        bent.plot(*shape.T, color=BLUE, linewidth=1)
    bent.plot(*shapes[:, -1].T, "o", color=ORANGE, markersize=4, label="tip, exosight")
    for k in (0, 1, 2, 5, 10):
        bent.annotate(f"{alpha[k]:g}", shapes[k, -1], xytext=(4, 2), textcoords="offset points", fontsize=8)
    bent.set(xlabel="x / L [-]", ylabel="z / L [-]", aspect="equal", xlim=(0, 1.1), ylim=(-0.05, 0.95))
    bent.set_title("The rod under P L²/EI = 0, 1, … 10", fontsize=9)
    bent.legend(frameon=False, fontsize=8, loc="upper right")

    for axis, color, name in ((1, BLUE, "deflection z / L"), (0, ORANGE, "reach x / L")):
        over_load.plot(loads, exact[:, axis], color=GRAY, linewidth=3)
        over_load.plot(alpha, shapes[:, -1, axis], "o", color=color, markersize=4, label=name)
    over_load.plot([], [], color=GRAY, linewidth=3, label="elastica")
    over_load.set(xlabel="load P L²/EI [-]", ylabel="tip position [-]", ylim=(0, 1.05))
    over_load.set_title("The tip over the load", fontsize=9)
    over_load.legend(frameon=False, fontsize=8)
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "cantilever.png", dpi=200)
    return float(shapes[-1, -1, 1])


if __name__ == "__main__":
    print(f"deflection of the tip at P L²/EI = 10: {main():.5f} L")
