"""How good the estimator is: numbers, tables and figures beside the paper's.

metrics           RMSE, RMS% of range and Pearson's r of C1…C7
details           R², contact or none, rare errors, loading against unloading
coverage          whether intervals hold what they promise
ood_detection     whether the OOD score tells
robustness        forces from noisy and low-contrast images
identifiability   the smallest force that one view resolves, whatever reads it
baselines         what is known of the forces without a picture
published         the paper's results
tables            rows with units, for report, terminal, CSV and JSON
figures           what the paper shows, and what it does not
"""

from exosight.evaluation.baselines import evaluate_baselines
from exosight.evaluation.coverage import Coverage, calibration_table, evaluate_intervals, interval_table
from exosight.evaluation.details import Detail, detail_table, evaluate_details
from exosight.evaluation.metrics import CONTACTS, ContactMetrics, Scores, Spread, score
from exosight.evaluation.ood_detection import OodDetection, auroc, evaluate_ood_detection, ood_detection_table
from exosight.evaluation.robustness import evaluate_robustness
from exosight.evaluation.tables import (
    Cell,
    Column,
    Table,
    contact_table,
    largest_table,
    mean_table,
    robustness_table,
)

__all__ = [
    "CONTACTS",
    "Cell",
    "Column",
    "ContactMetrics",
    "Coverage",
    "Detail",
    "OodDetection",
    "Scores",
    "Spread",
    "Table",
    "auroc",
    "calibration_table",
    "contact_table",
    "detail_table",
    "evaluate_baselines",
    "evaluate_details",
    "evaluate_intervals",
    "evaluate_ood_detection",
    "evaluate_robustness",
    "interval_table",
    "largest_table",
    "mean_table",
    "ood_detection_table",
    "robustness_table",
    "score",
]
