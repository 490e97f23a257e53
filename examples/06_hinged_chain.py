"""A chain of four hinged links released from horizontal: chaotic motion at a given tolerance.

Four slender links of 10 cm and 50 g each are connected by hinges without friction; the chain is released from
horizontal. The system is conservative, so the change of the computed energy is an error.
The same motion is computed at two tolerances.

The figure shows the chain every 50 ms of its first swing, the path of its end, and the deviation of the sum
of kinetic and potential energy from zero at both tolerances. The printed number is the speed of the chain's
end, in m/s, at 0.35 s, while it rises.
"""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from exosight.mechanics import Gravity, Link, MotionOptions, Revolute, Robot, evolve, walk

LENGTH, MASS, LINKS = 0.1, 0.05, 4
BLUE, ORANGE, GRAY = "#0072B2", "#E69F00", "#999999"
CM = 100.0


def chain() -> Robot:
    """Each link has its mass at its middle, and none at its end."""
    sites = np.array([[LENGTH / 2, 0.0, 0.0], [LENGTH, 0.0, 0.0]])
    slender = MASS * LENGTH**2 / 12 * np.diag([0.0, 1.0, 1.0])
    links = [
        Link(
            f"link_{i}",
            LENGTH,
            sites,
            parent=f"link_{i - 1}" if i else None,
            joint=Revolute((0.0, 1.0, 0.0)),
            mass=np.array([MASS, 0.0]),
            inertia=np.stack([slender, np.zeros((3, 3))]),
        )
        for i in range(LINKS)
    ]
    return Robot(tuple(links), (Gravity(jnp.array([0.0, 0.0, -9.81])),))


def main(folder: Path = Path("results/06_hinged_chain")) -> float:
    robot = chain()
    time = np.linspace(0.0, 1.0, 201)
    coarse, fine = (
        evolve([robot], time, options=MotionOptions(tolerance=tolerance)) for tolerance in (1e-6, 1e-9)
    )
    ends = np.asarray(jax.jit(jax.vmap(lambda q: walk(robot, q).position))(fine.q[0]))[:, 1::2, ::2]
    nodes = np.concatenate([np.zeros((len(time), 1, 2)), ends], axis=1)  # (times, hinges and end, x z)

    figure = Figure(figsize=(7.0, 3.8), layout="constrained")
    swing, energy = figure.subplots(1, 2, width_ratios=(1.3, 1))
    swing.plot(*(CM * nodes[:, -1].T), color=ORANGE, linewidth=0.8, label="path of the end, 1 s")
    for k in range(0, 81, 10):
        swing.plot(*(CM * nodes[k].T), "-o", color=BLUE, alpha=0.25 + k / 110, linewidth=1.5, markersize=2.5)
        if k % 20 == 0:
            label, at = f"{1000 * time[k]:.0f} ms", CM * nodes[k, -1]
            swing.annotate(label, at, xytext=(4, -8), textcoords="offset points", fontsize=7)
    swing.set(xlabel="x [cm]", ylabel="z [cm]", aspect="equal", xlim=(-45, 60), ylim=(-45, 14))
    swing.legend(frameon=False, fontsize=8, loc="upper left")
    swing.set_title("The chain, every 50 ms up to 400 ms", fontsize=9)

    for found, tolerance, color in ((coarse, "1 µm", ORANGE), (fine, "1 nm", BLUE)):
        lost = np.abs(found.kinetic[0] + found.potential[0])[1:]
        label = f"{tolerance} per step, {found.steps[0, -1]} steps"
        energy.semilogy(time[1:], 1000 * lost, color=color, label=label)
    energy.semilogy(time[1:], 1000 * fine.kinetic[0, 1:], color=GRAY, label="kinetic energy")
    energy.set(xlabel="time [s]", ylabel="energy, and its error [mJ]", ylim=(1e-12, 1e4))
    energy.legend(frameon=False, fontsize=8, loc="lower right")
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "hinged_chain.png", dpi=200)

    at = int(np.argmin(np.abs(time - 0.35)))
    by_q = jax.jit(lambda q: walk(robot, q).point_jacobian()[-1])(fine.q[0, at])
    return float(np.linalg.norm(by_q @ fine.velocity[0, at]))


if __name__ == "__main__":
    print(f"the end moves at {main():.5f} m/s after 0.35 s")
