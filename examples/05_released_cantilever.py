"""Motion of a horizontal soft cantilever released under its own weight, compared with SoRoSim.

A silicone-like rod (E = 1 MPa, 1000 kg/m³), 30 cm long and 2 cm thick, is clamped horizontally; at
t = 0 gravity is applied. The material is viscous (10 kPa s in shear, so 30 kPa s in extension). Bending
and extension on Legendre polynomials of degree 5: twelve coordinates. A second of motion takes some fifty
steps; the figure uses a hundred output times.

The figure shows the rod every 50 ms, its tip over time with the solution of the MATLAB toolbox SoRoSim on the
same discretisation, and the energy balance. The printed number is the downward displacement of the tip after
1 s, in metres; SoRoSim gives 0.252556.
"""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from exosight.mechanics import Circular, Gauss, Gravity, Legendre, Robot, Rod, evolve, walk

BLUE, ORANGE, GREEN, GRAY = "#0072B2", "#E69F00", "#009E73", "#999999"
REFERENCE = Path(__file__).parents[1] / "tests" / "reference" / "sorosim_dynamics.json"
CM, MJ = 100.0, 1000.0


def cantilever(points: Gauss) -> Robot:
    rod = Rod(
        "rod",
        0.3,
        Circular(np.full(points.size, 0.01)),
        young=1e6,
        density=1000.0,
        viscosity=3e4,
        strains={"bend_y": Legendre(5), "stretch_x": Legendre(5)},
        quadrature=points,
    )
    return Robot((rod,), (Gravity(jnp.array([0.0, 0.0, -9.81])),))


def positions(robot: Robot, q: np.ndarray) -> np.ndarray:
    """x and z of each point, for each q [m]."""
    return np.asarray(jax.jit(jax.vmap(lambda q: walk(robot, q).position[:, ::2]))(q))


def main(folder: Path = Path("results/05_released_cantilever")) -> float:
    robot = cantilever(Gauss(1, 6))
    time = np.linspace(0.0, 1.0, 101)
    found = evolve([robot], time)
    tips = positions(robot, found.q[0])[:, -1]
    shapes = positions(cantilever(Gauss(1, 30)), found.q[0, :41:5])  # more points, for a smooth curve

    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    swing, over_time, energy = figure.subplot_mosaic([["swing", "tip"], ["swing", "energy"]]).values()
    for k, shape in enumerate(shapes):
        swing.plot(*(CM * shape.T), color=BLUE, alpha=0.25 + 0.09 * k, linewidth=1.5)
        if k <= 6:
            label = f"{50 * k} ms"
            swing.annotate(label, CM * shape[-1], xytext=(3, -3), textcoords="offset points", fontsize=7)
    swing.set(xlabel="x [cm]", ylabel="z [cm]", aspect="equal", xlim=(-1, 36))
    swing.set_title("The rod, every 50 ms up to 400 ms", fontsize=9)

    reference = json.loads(REFERENCE.read_text())
    tip = CM * np.array(reference["tip"])
    for axis, color, name in ((0, ORANGE, "x"), (1, BLUE, "z")):
        over_time.plot(time, CM * tips[:, axis], color=color, label=f"{name}, exosight")
        at = tip[:, 2 * axis]
        over_time.plot(reference["time"], at, "o", color=color, markersize=3.5, markerfacecolor="white")
    over_time.plot([], [], "o", color=GRAY, markersize=3.5, markerfacecolor="white", label="SoRoSim")
    over_time.set(xlabel="time [s]", ylabel="tip [cm]")
    over_time.legend(frameon=False, fontsize=8)

    parts = (found.kinetic, found.potential - found.potential[0, 0], found.dissipated)
    names = ("kinetic", "potential", "dissipated")
    for part, name, color in zip(parts, names, (ORANGE, BLUE, GREEN), strict=True):
        energy.plot(time, MJ * part[0], color=color, label=name)
    energy.plot(time, MJ * sum(part[0] for part in parts), color=GRAY, linestyle="--", label="sum")
    energy.set(xlabel="time [s]", ylabel="energy [mJ]", ylim=(-95, 50))
    energy.legend(frameon=False, fontsize=8, ncols=2, loc="lower center")
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "released_cantilever.png", dpi=200)
    return float(-tips[-1, 1])


if __name__ == "__main__":
    print(f"the tip has fallen by {main():.6f} m after 1 s")
