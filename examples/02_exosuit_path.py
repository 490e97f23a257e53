"""Loading path of one exosuit: contact forces on the finger over the actuation.

The exosuit of the publication's controller, a silicone rod of 9.5 cm that tapers from a radius of 1 cm to
0.5 cm (Learning User Interaction Forces using Vision for a Soft Finger Exosuit), is clamped above the base of
a finger with three joints. The actuation u pushes along its upper surface, so that it bends onto the finger
and flexes it. u rises from 0 to 4 N and falls back to 0, in steps of 0.05 N; each stable equilibrium is the
initial value of the next.

The figure shows poses with u rising, the forces on the finger's spheres C1…C7 (circles), and F_net, their
sum. Near 2.8 N the exosuit snaps from one stable pose to another and F_net jumps; with u falling it does so
near 2.3 N: hysteresis without friction. The printed number is F_net at 4 N, in newtons.
"""

from pathlib import Path

import jax
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from exosight.exosuit.assembly import QUADRATURE, Exosuit
from exosight.exosuit.published import published
from exosight.exosuit.shapes import ExosuitShape, Linear, radius
from exosight.mechanics import drive
from exosight.system.observation import observe
from exosight.system.system import stack_systems

BLUE, ORANGE, BLACK = "#0072B2", "#E69F00", "#000000"
COLOURS = ("#000000", "#56B4E9", "#009E73", "#CC79A7", "#0072B2", "#D55E00", "#E69F00")
CONTACTS = {f"C{i}": colour for i, colour in enumerate(COLOURS, start=1)}
"""The finger's spheres and their colours, colour-blind safe."""
CM = 100.0


def outline(axis: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """The edge of a tube around an axis in the x–z plane."""
    along = np.gradient(axis, axis=0)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    return np.concatenate([axis + radii[:, None] * normal, (axis - radii[:, None] * normal)[::-1]])


def draw(ax: Axes, exosuit: Exosuit, centreline: np.ndarray, nodes: np.ndarray) -> None:
    finger = exosuit.finger
    for link in range(len(nodes) - 1):
        base, end = nodes[link : link + 2]
        edge = outline(nodes[link : link + 2], np.array(finger.radii[link : link + 2]))
        ax.add_patch(Polygon(CM * edge, facecolor="#DDDDDD", edgecolor="none"))
        centre = base + finger.centre_of_mass(link) / finger.lengths[link] * (end - base)
        for at, size in zip((base, centre), finger.sphere_radii()[2 * link :], strict=False):
            ax.add_patch(Circle(CM * at, CM * size, fill=False, edgecolor="#777777", linewidth=0.6))
    radii = radius(exosuit.shape.surface, QUADRATURE.points)
    edge = CM * outline(centreline, radii)
    ax.add_patch(Polygon(edge, facecolor=ORANGE, edgecolor=BLACK, linewidth=0.5, alpha=0.85))


def main(folder: Path = Path("results/02_exosuit_path")) -> float:
    exosuit = Exosuit(ExosuitShape(Linear(r0=0.010, r1=0.005), length=0.095))
    up = np.linspace(0.0, 4.0, 81)
    u = np.concatenate([up, up[-2::-1]])
    system = published(exosuit)
    found = drive([system.robot], u[:, None])
    observed = jax.tree.map(lambda leaf: np.asarray(leaf[0]), observe(stack_systems([system]), found.q))
    readings = {name: observed.readings[:, system.schema.index(name)] for name in (*CONTACTS, "F_net")}

    figure = Figure(figsize=(7.0, 4.8), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=(1, 1.4))
    panels = above.subplots(1, 4, sharey=True)
    for ax, load in zip(panels, (0.0, 1.0, 2.4, 4.0), strict=True):
        k = int(np.argmin(np.abs(up - load)))
        draw(ax, exosuit, observed.axes["exosuit"][k][:, ::2], observed.axes["finger"][k][:, ::2])
        ax.set(aspect="equal", xlim=(-1.5, 10.5), ylim=(-6, 4), xlabel="x [cm]")
        ax.set_title(f"u = {load:g} N", fontsize=9)
    panels[0].set_ylabel("z [cm]")

    contacts, net = below.subplots(1, 2)
    for name, color in CONTACTS.items():
        if readings[name][: len(up)].max() > 0:
            contacts.plot(up, readings[name][: len(up)], color=color, label=name)
    contacts.set(xlabel="actuation u [N]", ylabel="contact force [N]")
    contacts.set_title("Force on each of the finger's spheres, u rising", fontsize=9)
    contacts.legend(frameon=False, fontsize=8)
    f_net = readings["F_net"]
    net.plot(up, f_net[: len(up)], color=BLUE, linewidth=2.5, label="u rising")
    net.plot(u[len(up) - 1 :], f_net[len(up) - 1 :], color=ORANGE, linewidth=1.2, label="u falling")
    net.set(xlabel="actuation u [N]", ylabel="force on the finger F_net [N]")
    net.set_title("F_net, their sum, u rising and falling", fontsize=9)
    net.legend(frameon=False, fontsize=8)
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "exosuit_path.png", dpi=200)
    return float(f_net[len(up) - 1])


if __name__ == "__main__":
    print(f"F_net at u = 4 N: {main():.4f} N")
