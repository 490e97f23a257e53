"""
Your own finger
===============

Size and joint stiffness of the finger, their effect on the forces, and estimates of a network that was not
trained on such a finger.
"""

# %%
# Parameters of the finger
# ------------------------
#
# Lengths of three phalanges and a fingertip, radii at their ends, springs and ranges of three hinges.
# One variant is a tenth smaller than the published finger, the other half as stiff.

from dataclasses import replace

import numpy as np

from exosight.control import CONTROL_SHAPE
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.finger import Finger
from exosight.exosuit.index import index
from exosight.system.simulation import simulate_path

nominal = Finger()
small = replace(
    nominal,
    lengths=tuple(0.9 * length for length in nominal.lengths),
    radii=tuple(0.9 * radius for radius in nominal.radii),
)
supple = replace(nominal, joint_stiffness=tuple(0.5 * k for k in nominal.joint_stiffness))
FINGERS = {"published": nominal, "10 % smaller": small, "half as stiff": supple}

# %%
# The same exosuit on each finger
# -------------------------------
#
# Joint angles are flexion, from base to tip. The finger is passive: joints deflect against their springs.

LOAD = 2.4  # [N]
systems = {name: index(Exosuit(CONTROL_SHAPE, finger=finger)) for name, finger in FINGERS.items()}
found = {name: simulate_path(system, np.array([[LOAD]])).observation for name, system in systems.items()}
names = [sensor.name for sensor in systems["published"].schema.sensors]
readings = {name: dict(zip(names, at.readings[0], strict=True)) for name, at in found.items()}
for name, at in readings.items():
    angles = ", ".join(f"{np.degrees(at[f'angle_{i}']):.0f}°" for i in (1, 2, 3))
    forces = " ".join(f"{1000 * at[f'C{i}']:4.0f}" for i in range(1, 8))
    print(f"{name:14s} F_net {at['F_net']:.3f} N, C1…C7 [mN] {forces}, joints {angles}")

# %%
from exosight.evaluation.figures import pose_strip
from exosight.vision.scene import picture

images = np.concatenate([picture(systems[name], found[name].axes) for name in FINGERS])
seen = pose_strip(images, list(FINGERS))

# %%
# Estimates of the shipped network
# --------------------------------
#
# The shipped network was trained on the published finger only. Images of a finger of half the stiffness are
# plausible, and the estimate is the force that the published finger would need for that pose: about
# twice the true force. The OOD score stays below 1, because the image is not unusual. **No
# silhouette determines a stiffness**: forces in newtons require a measured one (:doc:`/identifiability`).

from exosight.control import OnnxEstimator
from exosight.control.estimator import SHIPPED_MODELS

reading = OnnxEstimator.load(SHIPPED_MODELS["index"]).read(images)
for i, (name, at) in enumerate(readings.items()):
    print(
        f"{name:14s} true {at['F_net']:.3f} N, estimated {reading.forces[i].sum():.3f} N, "
        f"OOD score {reading.ood_score[i]:.2f}"
    )

# %%
# Datasets in which the finger varies
# -----------------------------------
#
# Training on varying fingers gives wider prediction intervals: ``exosight generate`` takes
# ``--plant.link-length 0.9 1.1 --plant.joint-stiffness 0.5 2`` and similar options, and stores the drawn
# parameters with every frame. In Python it is one draw per shape:

from exosight.exosuit.assembly import varied
from exosight.exosuit.variation import PlantVariation, draw_variant

variation = PlantVariation(link_length=(0.9, 1.1), joint_stiffness=(0.5, 2.0))
drawn = draw_variant(variation, 0, 3)
print("drawn for shape 3 of seed 0: links ×", np.round(drawn.link_length, 3))
print("                             hinges ×", np.round(drawn.joint_stiffness, 3))
worn = index(varied(Exosuit(CONTROL_SHAPE), drawn))
at = simulate_path(worn, np.array([[LOAD]])).observation
print(f"F_net at {LOAD} N: {at.readings[0, names.index('F_net')]:.3f} N")

# %%
# If the finger has been measured, fine-tune the network instead: ``exosight generate --system index --seed
# 7`` with its parameters, then ``exosight train --pretrained shipped --epochs 4``, which takes minutes
# (:doc:`/accuracy`).
