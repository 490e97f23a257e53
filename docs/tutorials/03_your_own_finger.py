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
from exosight.exosuit.published import published
from exosight.exosuit.simulation import simulate

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
found = {name: simulate(Exosuit(CONTROL_SHAPE, finger=finger), [LOAD]) for name, finger in FINGERS.items()}
net_forces = {name: float(at.reading("F_net")[0]) for name, at in found.items()}
for name, at in found.items():
    angles = ", ".join(f"{round(float(at.reading(f'angle_{i}')[0] * 180 / np.pi))}°" for i in (1, 2, 3))
    forces = " ".join(f"{1000 * float(at.reading(f'C{i}')[0]):4.0f}" for i in range(1, 8))
    print(f"{name:14s} F_net {net_forces[name]:.3f} N, C1…C7 [mN] {forces}, joints {angles}")

# %%
from exosight.evaluation.figures import pose_strip
from exosight.vision.scene import picture

images = np.concatenate(
    [
        picture(published(Exosuit(CONTROL_SHAPE, finger=finger)), found[name].observation.axes)
        for name, finger in FINGERS.items()
    ]
)
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
from exosight.control.estimator import DEFAULT_MODEL

reading = OnnxEstimator.load(DEFAULT_MODEL).read(images)
for i, (name, net_force) in enumerate(net_forces.items()):
    print(
        f"{name:14s} true {net_force:.3f} N, estimated {reading.forces[i].sum():.3f} N, "
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
worn = varied(Exosuit(CONTROL_SHAPE), drawn)
print(f"F_net at {LOAD} N: {float(simulate(worn, [LOAD]).reading('F_net')[0]):.3f} N")

# %%
# If the finger has been measured, fine-tune the network instead: ``exosight generate --seed 7`` with its
# parameters, then ``exosight train --pretrained shipped --epochs 4``, which takes minutes (:doc:`/accuracy`).
