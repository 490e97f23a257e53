"""Figures of the results: plain arrays in, a Matplotlib Figure out, one look for all.

loading_path, find_snaps, pose_strip                        motion.py
overview, Outline                                           published.py
loss_curves                                                 learning.py
sample_traces, predicted_against_true, rainclouds           accuracy.py
reliability                                                 reliability.py
corrupted_examples, robustness_bars                         robustness.py
curves, Curve, Panel                                        lines.py
to_bytes                                                    style.py
"""

from exosight.evaluation.figures.accuracy import predicted_against_true, rainclouds, sample_traces
from exosight.evaluation.figures.learning import loss_curves
from exosight.evaluation.figures.lines import Curve, Panel, curves
from exosight.evaluation.figures.motion import find_snaps, loading_path, pose_strip
from exosight.evaluation.figures.published import Outline, overview
from exosight.evaluation.figures.reliability import reliability
from exosight.evaluation.figures.robustness import corrupted_examples, robustness_bars
from exosight.evaluation.figures.style import to_bytes

__all__ = [
    "Curve",
    "Outline",
    "Panel",
    "corrupted_examples",
    "curves",
    "find_snaps",
    "loading_path",
    "loss_curves",
    "overview",
    "pose_strip",
    "predicted_against_true",
    "rainclouds",
    "reliability",
    "robustness_bars",
    "sample_traces",
    "to_bytes",
]
