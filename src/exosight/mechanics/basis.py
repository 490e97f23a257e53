"""Bases of functions on [0, 1] in which a strain component is expanded: ξ(X) = Σ_k φ_k(X) q_k.

Adding a basis means adding a frozen dataclass with `size` and `evaluate`.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from exosight.errors import InputError


@runtime_checkable
class Basis(Protocol):
    """Functions φ_0 … φ_{size−1} on [0, 1]; hashable, so that compiled code can be shared."""

    @property
    def size(self) -> int:
        """Number of functions, and so of degrees of freedom."""
        ...

    def evaluate(self, x: Float[np.ndarray, " points"]) -> Float[np.ndarray, "points size"]:
        """The value of each function at `x`."""
        ...


@dataclass(frozen=True)
class NodalQuadratic:
    """Continuous piecewise quadratics, one function per node: 2·elements + 1 nodes, evenly spaced.

    q_k is the strain at node k. This is the paper's "nodal strain basis akin to the quadratic FEM
    basis"; with 5 elements, 11 nodes.
    """

    elements: int

    def __post_init__(self) -> None:
        if self.elements < 1:
            raise InputError(f"NodalQuadratic: expected at least 1 element, got {self.elements}")

    @property
    def size(self) -> int:
        """2·elements + 1."""
        return 2 * self.elements + 1

    def evaluate(self, x: Float[np.ndarray, " points"]) -> Float[np.ndarray, "points size"]:
        """The three Lagrange parabolas of the element that holds each point, zero elsewhere."""
        element = np.clip(np.floor(x * self.elements).astype(int), 0, self.elements - 1)
        t = x * self.elements - element
        values = np.zeros((len(x), self.size))
        rows = np.arange(len(x))
        values[rows, 2 * element] = (1 - t) * (1 - 2 * t)
        values[rows, 2 * element + 1] = 4 * t * (1 - t)
        values[rows, 2 * element + 2] = t * (2 * t - 1)
        return values


@dataclass(frozen=True)
class Legendre:
    """Legendre polynomials P_0 … P_degree of 2X − 1: orthogonal on [0, 1], all 1 at the tip."""

    degree: int

    def __post_init__(self) -> None:
        if self.degree < 0:
            raise InputError(f"Legendre: expected a degree of at least 0, got {self.degree}")

    @property
    def size(self) -> int:
        """degree + 1."""
        return self.degree + 1

    def evaluate(self, x: Float[np.ndarray, " points"]) -> Float[np.ndarray, "points size"]:
        """P_k(2X − 1), k = 0 … degree."""
        return np.polynomial.legendre.legvander(2 * x - 1, self.degree)
