"""
Your own network
================

Train the light network on a dataset of your own, judge it as the paper does, and put any estimator you like,
of any library, in its place.
"""

# %%
# A dataset
# ---------
#
# Eleven shapes make a bad network quickly; 440 shapes or more make a good one (the shipped one has met
# 4,892).

import tempfile
from pathlib import Path

import numpy as np

from exosight.app.data import load
from exosight.app.pipeline import fit
from exosight.dataset import make_split
from exosight.dataset.generation import GenerateConfig, generate
from exosight.learning import TrainConfig

PER_SCENARIO, FRAMES, EPOCHS = 1, 25, 6

folder = Path(tempfile.mkdtemp())
generate(GenerateConfig(per_scenario=PER_SCENARIO, frames=FRAMES, seed=11), folder / "data")
data = load(folder / "data")
split = make_split(data.frames, "frame", seed=0)
print(f"{len(split.train)} frames to learn from, {len(split.test)} to be judged on")

# %%
# Train, export
# -------------
#
# ``fit`` writes checkpoint, loss curves and ``model.onnx`` into a folder; a stopped run goes on with
# ``resume=True``. The split is by frame here because eleven shapes are too few to keep some back; use
# ``"shape"`` for an honest figure. For 128 × 128 pictures of a set-up like the published one,
# ``pretrained=load_pretrained(DEFAULT_MODEL)`` goes on from the shipped network instead of from nothing.

history = fit(data, split, TrainConfig(epochs=EPOCHS, threads=1), folder / "light", resume=False)
print(f"validation error after {len(history)} epochs: {history[-1].validation_l1:.4f} N")

# %%
from exosight.control import OnnxEstimator
from exosight.evaluation import score
from exosight.evaluation.figures import loss_curves

epochs, learned, rates = np.array([(r.epoch, r.train_loss, r.learning_rate) for r in history]).T
checks = np.array([(r.epoch, r.validation_loss) for r in history if r.validation_loss is not None]).T
curves = loss_curves(epochs.astype(int), learned, checks[0].astype(int), *checks[1:], rates, "loss [-]")
network = OnnxEstimator.load(folder / "light" / "model.onnx")
truth, images = data.frames.forces[split.test], data.frames.images[split.test]
print(f"light network: mean r {score(truth, network.estimate(images)).r.mean:.2f}")

# %%
# An estimator of your own
# ------------------------
#
# Evaluation and control know an estimator as an object with ``estimate(images) -> forces``, images of
# (frames, height, width) gray values 0…255, forces of (frames, 7) newtons. Whatever stands behind it is
# your affair; here it is linear regression on shrunken images in eight lines of NumPy.

from exosight.control import Estimator


class Ridge:
    """Forces as a linear map of the image at an eighth of its size, with a penalty on large weights."""

    def __init__(self, images, forces, penalty=3.0):
        features = self.features(images)
        gram = features.T @ features + penalty * np.eye(features.shape[1])
        self.weights = np.linalg.solve(gram, features.T @ forces)

    @staticmethod
    def features(images):
        small = images.reshape(len(images), 16, 8, 16, 8).mean(axis=(2, 4)).reshape(len(images), -1)
        return np.column_stack([small / 255, np.ones(len(images))])

    def estimate(self, images):
        return np.maximum(self.features(images) @ self.weights, 0).astype(np.float32)


ridge = Ridge(data.frames.images[split.train], data.frames.forces[split.train])
assert isinstance(ridge, Estimator)
print(f"ridge regression: mean r {score(truth, ridge.estimate(images)).r.mean:.2f}")

# %%
# It closes the loop like any other, however badly:

from exosight.control import CONTROL_SHAPE, Proportional, from_image, hold, run
from exosight.control.simulated import SimulatedPlant
from exosight.exosuit.assembly import Exosuit

record = run(SimulatedPlant(Exosuit(CONTROL_SHAPE)), Proportional(5.0), from_image(ridge), hold(0.25, 8))
true, told = record.F_net_true[-1], record.F_net_estimated[-1]
print(f"after {len(record.u) - 1} steps: true {true:.2f} N, told {told:.2f} N")

# %%
# A PyTorch network of your own, trained by the same recipes and exported with the same intervals, is an
# entry of ``NETWORKS``: :doc:`/extending`.
