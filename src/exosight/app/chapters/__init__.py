"""The sections of a study's report: results in, text, tables and figures out.

Numbers in the text come from the results; what the text says without one is true of every study.

introduction, motion, data_section            system.py
learning, accuracy, robustness_section        estimator.py
closed_loop                                   loop.py
contact_models                                surfaces.py
headline, limits, remake                      summary.py
"""

from exosight.app.chapters.estimator import accuracy, learning, robustness_section
from exosight.app.chapters.loop import closed_loop
from exosight.app.chapters.summary import headline, limits, remake
from exosight.app.chapters.surfaces import contact_models
from exosight.app.chapters.system import data_section, introduction, motion

__all__ = [
    "accuracy",
    "closed_loop",
    "contact_models",
    "data_section",
    "headline",
    "introduction",
    "learning",
    "limits",
    "motion",
    "remake",
    "robustness_section",
]
