"""How good the estimator is: numbers, tables and figures beside the paper's.

metrics      RMSE, RMS% of range and Pearson's r of C1…C7
robustness   the same on noisy and low-contrast images
published    the paper's results
tables       rows with units, for report, terminal, CSV and JSON
figures      what the paper shows, and what it does not
"""

from exosight.evaluation.metrics import CONTACTS, ContactMetrics, Scores, Spread, score
from exosight.evaluation.robustness import evaluate_robustness
from exosight.evaluation.tables import (
    Column,
    Table,
    contact_table,
    largest_table,
    mean_table,
    robustness_table,
)

__all__ = [
    "CONTACTS",
    "Column",
    "ContactMetrics",
    "Scores",
    "Spread",
    "Table",
    "contact_table",
    "evaluate_robustness",
    "largest_table",
    "mean_table",
    "robustness_table",
    "score",
]
