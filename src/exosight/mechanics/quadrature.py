"""Quadrature points along a rod: for integrals of the energy, poses and contact spheres."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from exosight.errors import InputError


@dataclass(frozen=True)
class Gauss:
    """Gauss–Legendre points in equal elements of [0, 1], plus both ends with weight zero.

    elements       number of elements
    per_element    Gauss points in each; integrates degree 2·per_element − 1 exactly
    element_ends   whether the inner element ends are points too (SoRoSim has them)

    The paper's 42 points are `Gauss(5, 8)`. A nodal basis has kinks at the element ends: without points there
    a step crosses them, and the tip error stays at some 1e-7 of the length instead of decreasing further.
    """

    elements: int
    per_element: int
    element_ends: bool = False

    def __post_init__(self) -> None:
        if self.elements < 1 or self.per_element < 1:
            raise InputError(
                f"Gauss: expected at least 1 element and 1 point, got {self.elements} and {self.per_element}"
            )

    @property
    def size(self) -> int:
        """Number of points, both ends included."""
        inner = self.elements - 1 if self.element_ends else 0
        return self.elements * self.per_element + 2 + inner

    @property
    def points(self) -> Float[np.ndarray, " points"]:
        """X in [0, 1], ascending."""
        return _rule(self)[0].copy()

    @property
    def weights(self) -> Float[np.ndarray, " points"]:
        """Weights that sum to one; times the rod's length they integrate over arc length."""
        return _rule(self)[1].copy()


@lru_cache(maxsize=64)
def _rule(gauss: Gauss) -> tuple[np.ndarray, np.ndarray]:
    nodes, weights = np.polynomial.legendre.leggauss(gauss.per_element)
    starts = np.arange(gauss.elements)[:, None]
    x = ((starts + (nodes + 1) / 2) / gauss.elements).ravel()
    w = np.tile(weights / 2 / gauss.elements, gauss.elements)
    ends = np.linspace(0, 1, gauss.elements + 1) if gauss.element_ends else np.array([0.0, 1.0])
    x, w = np.concatenate([x, ends]), np.concatenate([w, np.zeros(len(ends))])
    order = np.argsort(x)
    return x[order], w[order]
