"""A network calibrated for one exosuit: its errors along the exosuit's own path are taken off (needs JAX).

A network that knows many exosuits is a little wrong on each of them, in the same way whenever it takes the
same pose. The path up and down, which `tune` solved, shows the poses that control will see.
"""

from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Bool, Float, Float32

from exosight.control.estimator import Reader, Reading
from exosight.control.paths import ControllerConfig
from exosight.errors import ConvergenceError, InputError
from exosight.exosuit.assembly import Exosuit, assemble, observe
from exosight.mechanics import drive, stack
from exosight.system.camera import Camera
from exosight.vision.scene import picture

_NEAR = 0.03
"""How far [N] from the path an estimate may lie, over all contacts, to be corrected by more than 61 %."""


@dataclass(frozen=True, eq=False)
class Calibrated:
    """An estimator whose forces are corrected by its errors on a path of poses.

        f = e − w (e_p − f_p),    w = exp(−½ (|e − e_p| / 0.03 N)²),

    with e the estimate, e_p the nearest one on the path and f_p the true forces there. Far from the path, on
    another exosuit or with a user who moves, it is what it was.

    estimator  the network
    estimated  (points, 7)   on C1…C7 at points of the path [N]
    true       (points, 7)   [N]
    joined     (points − 1)  there is a smooth way between a point and the next: the pose did not jump

    Raises InputError for fewer than two points, other shapes or numbers that are not finite.
    """

    estimator: Reader
    estimated: Float[np.ndarray, "points 7"]
    true: Float[np.ndarray, "points 7"]
    joined: Bool[np.ndarray, " ways"]

    def __post_init__(self) -> None:
        count = len(self.estimated)
        if count < 2 or not self.estimated.shape == self.true.shape == (count, 7):
            raise InputError("calibration: expected two points or more, with 7 forces each")
        if self.joined.shape != (count - 1,) or not self.joined.any():
            raise InputError("calibration: expected to be told which points are joined, at least two of them")
        if not (np.isfinite(self.estimated).all() and np.isfinite(self.true).all()):
            raise InputError("calibration: expected finite newtons, got a number that is not")

    def estimate(self, images: np.ndarray) -> Float32[np.ndarray, "frames 7"]:
        """Forces on C1…C7 [N], one row an image; arguments and errors as for `OnnxEstimator.read`."""
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

    def _error(self, estimate: Float[np.ndarray, "7"]) -> Float[np.ndarray, "7"]:
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


def calibrate_estimator(
    estimator: Reader, exosuit: Exosuit, config: ControllerConfig, camera: Camera
) -> Calibrated:
    """The network with its errors on this exosuit's path known.

    config   of this exosuit, from `tune`
    camera   that will look at it, of the size that the network was trained with

    Raises InputError for a camera of another size, ConvergenceError if the path has no stable pose at some
    load.
    """
    robot = assemble(exosuit)
    u = np.concatenate([config.loading.u, config.unloading.u[1:]])
    found = drive([robot], u[:, None])
    if not found.converged.all():
        lost = float(u[int(np.argmin(found.converged[0]))])
        raise ConvergenceError(f"no stable pose at u = {lost:g} N; tune with a smaller limit")
    pose = jax.tree.map(lambda leaf: np.asarray(leaf[0]), observe(stack([robot]), found.q))
    images = picture(exosuit, pose, camera)
    return Calibrated(
        estimator,
        estimated=estimator.read(images).forces.astype(float),
        true=np.asarray(pose.forces)[:, 1:].astype(float),
        joined=~np.asarray(found.snapped[0])[1:],
    )
