"""The probability of contact, made to hold on average.

Frames of rarely loaded contacts come more often in training, so a network takes them for likelier than they
are. A shift of each contact's log odds sets that right: on frames that took no part in training, as many are
then said to touch, probabilities added up, as do. Only forces have such a probability.
"""

import numpy as np
from jaxtyping import Bool, Float

_LARGEST = 20.0
"""Of a shift: odds of half a billion, beyond what float32 tells from certain."""


def contact_shift(
    probability: Float[np.ndarray, "frames forces"], touching: Bool[np.ndarray, "frames forces"]
) -> Float[np.ndarray, " forces"]:
    """What to add to each contact's log odds for the mean probability to be the share of frames that touch.

    probability   as the network tells it
    touching      whether it does
    returns       zero for a contact that always or never touches, of which these frames tell nothing
    """
    share = touching.mean(axis=0)
    p = probability.astype(np.float64)
    low, high = np.full(p.shape[1], -_LARGEST), np.full(p.shape[1], _LARGEST)
    for _ in range(60):  # halved until float64 tells no more
        shift = (low + high) / 2
        odds = np.exp(shift) * p
        too_high = (odds / (odds + 1 - p)).mean(axis=0) > share
        low, high = np.where(too_high, low, shift), np.where(too_high, shift, high)
    return np.where((share > 0) & (share < 1), (low + high) / 2, 0.0)
