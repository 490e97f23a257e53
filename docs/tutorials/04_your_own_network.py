"""
Your own network
================

Train the light network on a dataset of your own, evaluate it as in the paper, and replace it by an estimator
of any library.
"""

# %%
# Dataset
# -------
#
# Eleven shapes suffice for a demonstration only; an accurate network needs 440 shapes or more (the shipped
# one was trained on 4,892).

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
print(f"{len(split.train)} training frames, {len(split.test)} test frames")

# %%
# Training and export
# -------------------
#
# ``fit`` writes checkpoint, loss curves and ``model.onnx`` into a folder; ``resume=True`` continues an
# interrupted run. The split is by frame here because eleven shapes are too few to hold some out; use
# ``"design"`` to measure accuracy on unseen exosuits. For 128 × 128 images of a set-up like the published
# one, ``pretrained=load_pretrained(DEFAULT_MODEL)`` fine-tunes the shipped network.

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
truth, images = data.frames.labels[split.test], data.frames.images[split.test]
print(f"light network: mean r {score(data.frames.schema, truth, network.estimate(images)).r.mean:.2f}")

# %%
# An estimator of your own
# ------------------------
#
# Evaluation and control accept any object with ``estimate(images) -> forces``, images of
# (frames, height, width) gray values 0…255, forces of (frames, 7) newtons. This one is ridge
# regression on downsampled images in eight lines of NumPy.

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


ridge = Ridge(data.frames.images[split.train], data.frames.labels[split.train])
assert isinstance(ridge, Estimator)
print(f"ridge regression: mean r {score(data.frames.schema, truth, ridge.estimate(images)).r.mean:.2f}")

# %%
# It can close the loop like any other estimator, although inaccurately:

from exosight.control import CONTROL_SHAPE, Proportional, from_image, hold, run
from exosight.control.simulated import SimulatedPlant
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import published

plant = SimulatedPlant(published(Exosuit(CONTROL_SHAPE)))
law = Proportional(5.0, plant.schema.channels[0])
record = run(plant, law, from_image(ridge, plant.schema), hold(0.25, 8))
true, estimated = record.true[-1], record.estimated[-1]
print(f"after {len(record.command) - 1} steps: true {true:.2f} N, estimated {estimated:.2f} N")

# %%
# To train your own PyTorch network with the same recipes and export it with the same intervals, add an
# entry to ``NETWORKS``: :doc:`/extending`.
