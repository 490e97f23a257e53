"""The probability of contact, made to hold on average.

Frames of rarely loaded contacts come more often in training, so a network overestimates their probability.
A shift of each contact's log odds corrects that: on frames that took no part in training, the probabilities
then add up to the number of contacts. Only forces have such a probability.
"""

import numpy as np
from jaxtyping import Bool, Float

_LARGEST = 20.0
"""Of a shift: odds of half a billion, beyond which float32 rounds to certainty."""


def contact_shift(
    probability: Float[np.ndarray, "frames forces"], touching: Bool[np.ndarray, "frames forces"]
) -> Float[np.ndarray, " forces"]:
    """What to add to each contact's log odds for the mean probability to be the share of frames that touch.

    probability   as the network estimates it
    touching      whether it does
    returns       zero for a contact that always or never touches, which these frames do not determine
    """
    share = touching.mean(axis=0)
    p = probability.astype(np.float64)
    low, high = np.full(p.shape[1], -_LARGEST), np.full(p.shape[1], _LARGEST)
    for _ in range(60):  # halved down to the resolution of float64
        shift = (low + high) / 2
        odds = np.exp(shift) * p
        too_high = (odds / (odds + 1 - p)).mean(axis=0) > share
        low, high = np.where(too_high, low, shift), np.where(too_high, shift, high)
    return np.where((share > 0) & (share < 1), (low + high) / 2, 0.0)
