"""
Reproduce the paper
===================

The published system step by step: the force that its text states, images with known forces, estimation by a
network, robustness to noise, and the closed loop. ``exosight study --preset paper`` does the same with all
1375 shapes and both networks in hours; this tutorial uses eleven shapes and the shipped network.
"""

# %%
# The force stated in the text
# ----------------------------
#
# The exosuit of the paper's controller tapers from 1 cm to 0.5 cm over 9.5 cm. At u = 2.4 N the text states
# F_net = 0.2 N, the sum of the contact forces on C1 to C7. Loads increase from 0, as there.

import tempfile
from pathlib import Path

import numpy as np

from exosight.control import CONTROL_SHAPE
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.simulation import simulate

exosuit = Exosuit(CONTROL_SHAPE)
found = simulate(exosuit, [0.0, 1.2, 2.4, 4.0])
for u, net_force, ok in zip(found.u, found.reading("F_net"), found.equilibria.converged, strict=True):
    print(f"u = {u:.1f} N: F_net = {float(net_force):.3f} N, stable equilibrium: {bool(ok)}")

# %%
# Images with known forces
# ------------------------
#
# One exosuit of each of the eleven scenarios, actuated 0 → 4 → 0 N. The paper has 125 of each and 50 frames
# per path. Frames whose rod crosses itself, or whose tip lies below the fingertip, are dropped and counted.

from exosight.dataset import read_frames
from exosight.dataset.generation import GenerateConfig, generate
from exosight.evaluation.figures import pose_strip

PER_SCENARIO, FRAMES = 1, 25

folder = Path(tempfile.mkdtemp()) / "data"
manifest = generate(GenerateConfig(per_scenario=PER_SCENARIO, frames=FRAMES, seed=11), folder)
frames = read_frames(folder)
print(f"{len(frames)} frames kept; dropped: {manifest.dropped}")

strongest = [int(np.argmax(np.where(frames.design == i, frames.reading("F_net"), -1))) for i in range(11)]
strip = pose_strip(
    frames.images[strongest][:6],
    [f"u = {frames.commands[i, 0]:.1f} N\nF_net = {frames.reading('F_net')[i]:.2f} N" for i in strongest[:6]],
)

# %%
# Estimated forces
# ----------------
#
# None of these exosuits was used in training. The paper's numbers are printed for comparison; its split is by
# frame: nearly identical images of one exosuit may occur in both training and test set.

from exosight.control import OnnxEstimator
from exosight.control.estimator import DEFAULT_MODEL
from exosight.evaluation import score
from exosight.evaluation.figures import predicted_against_true
from exosight.evaluation.published import CONTACTS_PUBLISHED

network = OnnxEstimator.load(DEFAULT_MODEL)
estimated = network.estimate(frames.images)
scores = score(frames.schema, frames.labels, estimated)
print("        r   paper   RMSE [N]   paper")
for ours, paper in zip(scores.outputs, CONTACTS_PUBLISHED, strict=True):
    print(f"{ours.name}: {ours.r:6.3f}  {paper.r:6.2f}  {ours.rmse:9.4f}  {paper.rmse:6.2f}")
clouds = predicted_against_true(frames.schema, frames.labels, estimated)

# %%
# Robustness to noise
# -------------------
#
# Gaussian noise as MATLAB's ``imnoise`` adds it, on every third frame.

from exosight.vision import corrupt

some = slice(None, None, 3)
for name in ("noise-low", "noise-medium", "noise-high"):
    noisy = score(frames.schema, frames.labels[some], network.estimate(corrupt(frames.images[some], name, 0)))
    print(f"{name:13s} mean r {noisy.r.mean:.3f}, mean RMSE {noisy.rmse.mean:.4f} N")

# %%
# Closed-loop control
# -------------------
#
# The paper's law u_k = u_{k−1} + K_P e_k with K_P = 5, ten times a second, with the network as sensor. In the
# paper it settles at 0.25 N after 7 steps.

from exosight.control import Proportional, from_image, hold, measure_response, run
from exosight.control.simulated import SimulatedPlant
from exosight.exosuit.published import published

plant = SimulatedPlant(published(exosuit))
law = Proportional(5.0, plant.schema.channels[0])
record = run(plant, law, from_image(network, plant.schema), hold(0.25, 25))
response = measure_response(record.time, record.target, record.true, record.command, record.driven)
print(f"settled within 5 % after {response.settling_steps:.0f} steps")
print(f"F_net at the end: true {record.true[-1]:.3f} N, estimated {record.estimated[-1]:.3f} N")

# %%
# The complete study
# ------------------
#
# ``exosight study --preset quick --out results/quick`` takes minutes, ``--preset paper`` hours; both write
# one HTML report with the paper's tables and figures beside their own.
