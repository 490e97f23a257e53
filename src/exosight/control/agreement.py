"""Whether a network and an identified model agree on a picture, a signal of trust beside the OOD score.

    z_i = (n_i − m_i) / √(σ_n,i² + σ_m,i² + (MODEL_ERROR · max_j |m_j|)²)

with the network's values n, whose σ follows from their intervals as of normal errors, and the model's m.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from jaxtyping import Float

from exosight.control.estimator import Reading

MODEL_ERROR = 0.02
"""Of an identified model, as a share of its largest value: F_net of held-out loads is within 1 to 2 %."""
LIMIT = 3.0
"""Largest |z| of values that agree."""


@dataclass(frozen=True)
class Agreement:
    """Of the outputs that both give.

    names        of the outputs
    difference   (outputs,)   network less model [their units]
    deviation    (outputs,)   its standard deviation [their units]
    """

    names: tuple[str, ...]
    difference: Float[np.ndarray, " outputs"]
    deviation: Float[np.ndarray, " outputs"]

    @property
    def score(self) -> float:
        """Largest |z| as a share of LIMIT: above 1, they disagree."""
        return float(np.max(np.abs(self.difference) / self.deviation)) / LIMIT


def agreement(
    names: Sequence[str],
    reading: Reading,
    level: float,
    values: Float[np.ndarray, " outputs"],
    deviations: Float[np.ndarray, " outputs"],
) -> Agreement:
    """Of one picture.

    reading              of the network, of one picture
    level                of its intervals
    values, deviations   the model's, in the order of the network's outputs [their units]
    """
    network = reading.forces[0].astype(float)
    # An interval that ends at 0 is narrower there.
    half = np.maximum(reading.high[0] - network, network - reading.low[0])
    own = half / NormalDist().inv_cdf((1 + level) / 2)
    floor = max(MODEL_ERROR * float(np.abs(values).max()), 1e-9)
    return Agreement(tuple(names), network - values, np.sqrt(own**2 + deviations**2 + floor**2))
