"""How good an estimator is: numbers, tables and figures, of the published system beside the paper's.

metrics         RMSE, RMS% of range and Pearson's r of every output
details         R², contact detection, rare errors, loading against unloading
coverage        coverage and width of prediction intervals
ood_detection   AUROC of the OOD score
large_errors    whether the probability of a large error follows the errors
robustness      estimates from noisy and low-contrast images
baselines       estimates without an image
published       the paper's results
naming          names and units by the schema
tables          rows with units, for report, terminal, CSV and JSON
figures         the figures, one look for all
"""

from exosight.evaluation.baselines import evaluate_baselines
from exosight.evaluation.coverage import Coverage, calibration_table, evaluate_intervals, interval_table
from exosight.evaluation.details import Detail, detail_table, evaluate_details
from exosight.evaluation.metrics import Scores, SensorMetrics, Spread, score
from exosight.evaluation.ood_detection import OodDetection, auroc, evaluate_ood_detection, ood_detection_table
from exosight.evaluation.robustness import evaluate_robustness
from exosight.evaluation.tables import (
    Cell,
    Column,
    Table,
    largest_table,
    mean_table,
    robustness_table,
    sensor_table,
)

__all__ = [
    "Cell",
    "Column",
    "Coverage",
    "Detail",
    "OodDetection",
    "Scores",
    "SensorMetrics",
    "Spread",
    "Table",
    "auroc",
    "calibration_table",
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
    "sensor_table",
]
