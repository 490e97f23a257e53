"""Adaptation: a network that has learned already, changed by a few labelled pictures of another set-up."""

from exosight.learning.adaptation.labelled import Labelled
from exosight.learning.adaptation.methods import METHODS, Method
from exosight.learning.adaptation.selection import Adaptation, Candidate, adapt

__all__ = ["METHODS", "Adaptation", "Candidate", "Labelled", "Method", "adapt"]
