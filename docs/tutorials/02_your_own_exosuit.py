"""
Your own exosuit
================

Another shape, material and length: contact forces, camera images, and estimates of the shipped network. The
system is ``index``, whose surfaces press on each other (:doc:`/surface_contact`).
"""

# %%
# Shapes of the five families
# ---------------------------
#
# A shape is a surface S(X), the radius along the rod, and a length. Parameters are validated against the
# ranges of the paper's Table II.

import numpy as np
from matplotlib.figure import Figure

from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.index import index
from exosight.exosuit.shapes import ExosuitShape, Linear, Sine, Surface, radius
from exosight.system.simulation import simulate_path

taper = ExosuitShape(Linear(r0=0.009, r1=0.005), length=0.095)
waves = ExosuitShape(Sine(r0=0.007, a=-9.0), length=0.095)
try:
    Linear(r0=0.02, r1=0.005)
except ValueError as error:
    print(error)

# %%
# A surface of your own
# ---------------------
#
# A class with a ``profile`` that returns S and dS/dX in metres. This one is thin over the middle joint of
# the finger, where it should bend. All radii are clipped to 4…10 mm.

from dataclasses import dataclass
from typing import ClassVar


@dataclass(frozen=True)
class Waist(Surface):
    """S = R (1 − depth exp(−(X − at)² / 2 width²))."""

    family: ClassVar[str] = "waist"
    size: float = 0.008
    depth: float = 0.45
    at: float = 0.45
    width: float = 0.08

    def profile(self, x):
        dent = self.depth * np.exp(-0.5 * ((x - self.at) / self.width) ** 2)
        return self.size * (1 - dent), self.size * dent * (x - self.at) / self.width**2


waist = ExosuitShape(Waist(), length=0.095)

# %%
# Contact forces
# --------------
#
# F_net over rising u. A kink is a contact that closes or opens; a jump is a snap to another stable
# equilibrium.

SHAPES = {"taper": taper, "waves": waves, "waist": waist}
LOADS = np.arange(0.0, 4.01, 0.2)
COLOURS = {"taper": "#0072B2", "waves": "#E69F00", "waist": "#009E73"}

systems = {name: index(Exosuit(shape)) for name, shape in SHAPES.items()}
F_NET = systems["taper"].schema.index("F_net")
found = {name: simulate_path(system, LOADS[:, None]) for name, system in systems.items()}
forces = {name: path.observation.readings[:, F_NET] for name, path in found.items()}
curves = Figure(figsize=(7.0, 2.8), layout="constrained")
surface, force = curves.subplots(1, 2)
x = np.linspace(0, 1, 200)
for name, shape in SHAPES.items():
    surface.plot(100 * shape.length * x, 1000 * radius(shape.surface, x), color=COLOURS[name], label=name)
    force.plot(LOADS, forces[name], "o-", color=COLOURS[name], markersize=3, label=name)
surface.set(xlabel="along the exosuit [cm]", ylabel="radius [mm]", ylim=(0, 11))
force.set(xlabel="actuation u [N]", ylabel="F_net [N]")
force.legend(frameon=False)

for name, path in found.items():
    worst = float(np.max(path.equilibria.residual))
    print(f"{name}: F_net at 4 N = {forces[name][-1]:.3f} N, largest residual {worst:.0e}")

# %%
# Camera images
# -------------

from exosight.evaluation.figures import pose_strip
from exosight.vision.scene import picture

images = np.stack([picture(systems[name], found[name].observation.axes)[15] for name in SHAPES])
seen = pose_strip(images, [f"{name}, u = {LOADS[15]:.0f} N" for name in SHAPES])

# %%
# A softer or stiffer material
# ----------------------------
#
# Young's modulus is a field of the exosuit. Twice the modulus is not half the force: the pose differs too.
# Doubling u *and* every stiffness (finger and contact included) gives exactly twice the force in the same
# pose.

for young in (200e3, 300e3, 600e3):
    at = simulate_path(index(Exosuit(taper, young=young)), np.array([[2.4]])).observation
    print(f"E = {young / 1000:.0f} kPa: F_net at 2.4 N = {at.readings[0, F_NET]:.3f} N")

# %%
# Estimates of the shipped network
# --------------------------------
#
# It was trained on the five families, which do not include this waist. The OOD score
# indicates whether the estimate is reliable: above 1 it is not. Here it is below 1.

from exosight.control import OnnxEstimator
from exosight.control.estimator import SHIPPED_MODELS

network = OnnxEstimator.load(SHIPPED_MODELS["index"])
reading = network.read(images)
for i, name in enumerate(SHAPES):
    estimate, ood_score = reading.forces[i].sum(), reading.ood_score[i]
    print(f"{name}: true {forces[name][15]:.3f} N, estimated {estimate:.3f} N, OOD score {ood_score:.2f}")

# %%
# In the lab, for the five families: ``exosight lab --vary family=sine "r0=7 mm" a=-9``. To add a family to
# datasets: :doc:`/extending`.
