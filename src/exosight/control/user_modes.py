"""Whether a user rests or moves: a filter for each, weighted by how well it predicts.

Interacting multiple models (Blom and Bar-Shalom, IEEE Trans. Autom. Control 33, 1988). Before each step both
begin from a mixture of what they know, as a user may have begun to move, or stopped.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

_LEAST = 1e-9  # of a share: what has become impossible can become possible again


@dataclass(frozen=True)
class Motion:
    """How states of both modes change in a step.

    turn  (2, 2)     probability that a user of the mode of the row is of that of the column afterwards [-]
    move  (2, 3, 3)  from state to state
    stir  (2, 3, 3)  covariance of what is added
    """

    turn: Float[np.ndarray, "2 2"]
    move: Float[np.ndarray, "2 3 3"]
    stir: Float[np.ndarray, "2 3 3"]


@dataclass(frozen=True)
class UserModes:
    """What is known of the state if the user rests, and if he moves.

    share  (2,)       probability of each [-]
    x      (2, 3)     states
    p      (2, 3, 3)  their covariances
    """

    share: Float[np.ndarray, "2"]
    x: Float[np.ndarray, "2 3"]
    p: Float[np.ndarray, "2 3 3"]

    @property
    def mean(self) -> Float[np.ndarray, "3"]:
        """The state, whichever mode it is."""
        return self.share @ self.x

    @property
    def covariance(self) -> Float[np.ndarray, "3 3"]:
        """Of that state: within the modes, and between them."""
        return self._about(self.share, self.mean)

    def later(self, steps: int, motion: Motion) -> "UserModes":
        """The same so many steps later."""
        now = self
        for _ in range(steps):
            joint = now.share[:, None] * motion.turn
            share = joint.sum(axis=0)
            came = (joint / share).T  # from which mode, a row a mode afterwards
            x = came @ now.x
            p = np.stack([now._about(part, mean) for part, mean in zip(came, x, strict=True)])
            x = np.einsum("mij,mj->mi", motion.move, x)
            now = UserModes(share, x, motion.move @ p @ motion.move.transpose(0, 2, 1) + motion.stir)
        return now

    def weighted(self, log_likelihood: Float[np.ndarray, "2"]) -> "UserModes":
        """The same with shares by Bayes' rule."""
        share = np.maximum(self.share, _LEAST) * np.exp(log_likelihood - log_likelihood.max())
        return UserModes(share / share.sum(), self.x, self.p)

    def _about(self, share: np.ndarray, mean: np.ndarray) -> Float[np.ndarray, "3 3"]:
        off = self.x - mean
        return np.einsum("m,mij->ij", share, self.p + off[:, :, None] * off[:, None, :])
