"""A network calibrated for one system: its errors along the system's own path are taken off (needs JAX).

A network that was trained on many designs is a little wrong on each of them, in the same way whenever it
takes the same pose. The path up and down, which `tune` solved, shows the poses that control will see.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32

from exosight.control.estimator import Reader, Reading
from exosight.control.paths import ControllerConfig
from exosight.errors import InputError
from exosight.system.schema import difference
from exosight.system.simulation import simulate_path
from exosight.system.system import System
from exosight.vision.scene import picture

_NEAR = 0.03
"""How far [N] from the path an estimate may lie, over all outputs, to be corrected by more than 61 %."""


@dataclass(frozen=True, eq=False)
class Calibrated:
    """An estimator whose outputs are corrected by its errors on a path of poses.

        f = e − w (e_p − f_p),    w = exp(−½ (|e − e_p| / 0.03 N)²),

    with e the estimate, e_p the nearest one on the path and f_p the true forces there. Far from the path, on
    another design or with a user who moves, it is what it was.

    estimator  the network
    estimated  (points, outputs)   at points of the path [N]
    true       (points, outputs)   [N]
    joined     (points − 1)        there is a smooth way between a point and the next: the pose did not jump

    Raises InputError for fewer than two points, other shapes or numbers that are not finite.
    """

    estimator: Reader
    estimated: Float[np.ndarray, "points outputs"]
    true: Float[np.ndarray, "points outputs"]
    joined: Bool[np.ndarray, " ways"]

    def __post_init__(self) -> None:
        count = len(self.estimated)
        if count < 2 or self.estimated.shape != self.true.shape:
            raise InputError(
                "calibration: expected two points or more, with estimated and true outputs of one shape"
            )
        if self.joined.shape != (count - 1,) or not self.joined.any():
            raise InputError("calibration: expected which points are joined, at least two of them")
        if not (np.isfinite(self.estimated).all() and np.isfinite(self.true).all()):
            raise InputError("calibration: expected finite numbers, got one that is not")

    def estimate(self, images: np.ndarray) -> Float32[np.ndarray, "frames outputs"]:
        """Outputs, one row an image; arguments and errors as for `OnnxEstimator.read`."""
        return self.read(images).forces

    def read(self, images: np.ndarray, level: float = 0.9) -> Reading:
        """As `OnnxEstimator.read`; the intervals keep their width where that leaves them above 0 N."""
        seen = self.estimator.read(images, level)
        error = np.stack([self._error(row) for row in seen.forces.astype(float)]).astype(np.float32)
        zero = np.float32(0)
        return replace(
            seen,
            forces=np.maximum(seen.forces - error, zero),
            low=np.maximum(seen.low - error, zero),
            high=np.maximum(seen.high - error, zero),
        )

    def _error(self, estimate: Float[np.ndarray, " outputs"]) -> Float[np.ndarray, " outputs"]:
        """What is taken off one estimate [N]."""
        start = self.estimated[:-1][self.joined]
        way = self.estimated[1:][self.joined] - start
        length = np.maximum((way**2).sum(axis=1), 1e-30)
        share = np.clip(((estimate - start) * way).sum(axis=1) / length, 0, 1)[:, None]
        distance = np.linalg.norm(estimate - start - share * way, axis=1)
        nearest = int(distance.argmin())
        errors = self.estimated - self.true
        first, second = errors[:-1][self.joined][nearest], errors[1:][self.joined][nearest]
        weight = np.exp(-0.5 * (distance[nearest] / _NEAR) ** 2)
        return weight * (first + share[nearest] * (second - first))


def calibrate_estimator(estimator: Reader, system: System, config: ControllerConfig) -> Calibrated:
    """The network with its errors on this system's path known.

    system   its first camera is the one that will look at it, of the size that the network was trained with
    config   of this system, from `tune`

    Raises InputError for a configuration of another system, ConvergenceError if the path has no stable pose
    at some command.
    """
    found = difference(system.schema, config.schema)
    if found:
        raise InputError(f"calibration: expected a controller that was tuned for this system; {found}")
    u = np.concatenate([config.loading.u, config.unloading.u[1:]])
    path = simulate_path(system, config.commands(u))
    return Calibrated(
        estimator,
        estimated=estimator.read(picture(system, path.observation.axes)).forces.astype(float),
        true=np.asarray(path.observation.readings)[:, system.schema.output_indices()],
        joined=~np.asarray(path.equilibria.snapped)[1:],
    )
