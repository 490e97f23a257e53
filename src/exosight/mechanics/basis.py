"""Bases of functions on [0, 1] in which a strain component is expanded: ξ(X) = Σ_k φ_k(X) q_k.

Polynomials over the whole rod (`Monomial`, `Legendre`, `Chebyshev`), polynomials element by element
(`NodalLinear`, `NodalQuadratic`, `NodalCubic`, `Hermite`), waves (`Fourier`) and bumps (`Gaussian`). Adding a
basis means adding a frozen dataclass with `size` and `evaluate`.
"""

from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from exosight.errors import InputError

X = Float[np.ndarray, " points"]
Values = Float[np.ndarray, "points size"]


@runtime_checkable
class Basis(Protocol):
    """Functions φ_0 … φ_{size−1} on [0, 1]; hashable, so that compiled code can be shared."""

    @property
    def size(self) -> int:
        """Number of functions, and so of degrees of freedom."""
        ...

    def evaluate(self, x: X) -> Values:
        """The value of each function at `x`."""
        ...


def _at_least(basis: object, what: str, least: int, value: int) -> None:
    if not isinstance(value, int) or value < least:
        raise InputError(f"{type(basis).__name__}: expected {what} of at least {least}, got {value}")


@dataclass(frozen=True)
class _Polynomial:
    """Polynomials up to `degree`, in the basis of the subclass."""

    degree: int

    def __post_init__(self) -> None:
        _at_least(self, "a degree", 0, self.degree)

    @property
    def size(self) -> int:
        """degree + 1."""
        return self.degree + 1


class Monomial(_Polynomial):
    """Powers 1, X … X^degree.

    Nearly dependent at high degrees (their Gram matrix is Hilbert's, of condition 1e13 at degree 9): prefer
    `Legendre` or `Chebyshev`, which span the same polynomials, from degree 6 or so.
    """

    def evaluate(self, x: X) -> Values:
        """X^k, k = 0 … degree."""
        return np.vander(x, self.size, increasing=True)


class Legendre(_Polynomial):
    """Legendre polynomials P_0 … P_degree of 2X − 1: orthogonal on [0, 1], all 1 at the tip."""

    def evaluate(self, x: X) -> Values:
        """P_k(2X − 1), k = 0 … degree."""
        return np.polynomial.legendre.legvander(2 * x - 1, self.degree)


class Chebyshev(_Polynomial):
    """Chebyshev polynomials T_0 … T_degree of 2X − 1: between −1 and 1 everywhere, all 1 at the tip."""

    def evaluate(self, x: X) -> Values:
        """T_k(2X − 1) = cos(k arccos(2X − 1)), k = 0 … degree."""
        return np.polynomial.chebyshev.chebvander(2 * x - 1, self.degree)


@dataclass(frozen=True)
class _Elements:
    """Piecewise polynomials on `elements` equal parts of [0, 1]."""

    elements: int

    def __post_init__(self) -> None:
        _at_least(self, "a number of elements", 1, self.elements)

    def _place(self, x: X) -> tuple[np.ndarray, np.ndarray]:
        """The element of each point, and the local coordinate in it, from 0 to 1."""
        element = np.clip(np.floor(x * self.elements).astype(int), 0, self.elements - 1)
        return element, x * self.elements - element

    def _spread(self, first: np.ndarray, local: Float[np.ndarray, "points few"]) -> Values:
        """Values of the few functions of each point's element, which start at `first`, among all."""
        values = np.zeros((len(first), self.size))
        np.put_along_axis(values, first[:, None] + np.arange(local.shape[1]), local, axis=1)
        return values

    @property
    def size(self) -> int:
        """Number of functions."""
        raise NotImplementedError


class _Nodal(_Elements):
    """Continuous piecewise Lagrange polynomials of `degree`, one function per evenly spaced node."""

    degree: ClassVar[int]

    @property
    def size(self) -> int:
        """degree·elements + 1."""
        return self.degree * self.elements + 1

    def evaluate(self, x: X) -> Values:
        """Π_{m≠k} (t − t_m)/(t_k − t_m) over the nodes t_m of the element that holds each point."""
        element, t = self._place(x)
        nodes = np.arange(self.degree + 1) / self.degree
        local = [
            np.prod([(t - other) / (node - other) for other in nodes if other != node], axis=0)
            for node in nodes
        ]
        return self._spread(self.degree * element, np.stack(local, axis=1))


class NodalLinear(_Nodal):
    """Continuous piecewise lines, one function per node: elements + 1 nodes, evenly spaced.

    q_k is the strain at node k.
    """

    degree = 1


class NodalQuadratic(_Nodal):
    """Continuous piecewise quadratics, one function per node: 2·elements + 1 nodes, evenly spaced.

    q_k is the strain at node k. This is the paper's "nodal strain basis akin to the quadratic FEM
    basis"; with 5 elements, 11 nodes.
    """

    degree = 2


class NodalCubic(_Nodal):
    """Continuous piecewise cubics, one function per node: 3·elements + 1 nodes, evenly spaced.

    q_k is the strain at node k.
    """

    degree = 3


class Hermite(_Elements):
    """Piecewise cubics whose slope is continuous too, by value and slope at the ends of the elements.

    q_2k is the strain at node k of elements + 1, q_2k+1 its derivative by X there.
    """

    @property
    def size(self) -> int:
        """2·(elements + 1)."""
        return 2 * (self.elements + 1)

    def evaluate(self, x: X) -> Values:
        """The four cubic Hermite polynomials of the element that holds each point."""
        element, t = self._place(x)
        s, h = 1 - t, 1 / self.elements
        local = [s**2 * (1 + 2 * t), h * t * s**2, t**2 * (1 + 2 * s), -h * s * t**2]
        return self._spread(2 * element, np.stack(local, axis=1))


@dataclass(frozen=True)
class Fourier:
    """Constant and first harmonics: 1, cos 2πX, sin 2πX, cos 4πX, …: orthogonal, the same at base and tip.

    For strains that are periodic along the rod; one that is not needs very many waves near its ends.
    """

    harmonics: int

    def __post_init__(self) -> None:
        _at_least(self, "a number of harmonics", 0, self.harmonics)

    @property
    def size(self) -> int:
        """2·harmonics + 1."""
        return 2 * self.harmonics + 1

    def evaluate(self, x: X) -> Values:
        """1, then cos 2πkX and sin 2πkX, k = 1 … harmonics."""
        angle = 2 * np.pi * x[:, None] * np.arange(1, self.harmonics + 1)
        waves = np.stack([np.cos(angle), np.sin(angle)], axis=2).reshape(len(x), -1)
        return np.concatenate([np.ones((len(x), 1)), waves], axis=1)


@dataclass(frozen=True)
class Gaussian:
    """Bumps of one width, with their centres evenly spaced from base to tip.

    count   number of bumps
    width   standard deviation, as a fraction of the rod's length
    """

    count: int
    width: float

    def __post_init__(self) -> None:
        """Raises InputError also if the bumps are so wide that they are nearly linearly dependent."""
        _at_least(self, "a number of bumps", 2, self.count)
        if not (self.width > 0 and np.isfinite(self.width)):
            raise InputError(f"Gaussian: expected a finite width above 0 of the length, got {self.width}")
        # A rod's stiffness squares this: at 1e10, four to five digits are left to Newton's steps of residual.
        if np.linalg.cond(self.evaluate(self._centres)) > 1e5:
            raise InputError(
                f"Gaussian: {self.count} bumps of width {self.width} overlap too much to be told apart; "
                f"expected a width of at most some {1.5 / (self.count - 1):.2g}, 1.5 spacings"
            )

    @property
    def _centres(self) -> X:
        return np.linspace(0.0, 1.0, self.count)

    @property
    def size(self) -> int:
        """Number of bumps."""
        return self.count

    def evaluate(self, x: X) -> Values:
        """exp(−(X − X_k)²/2 width²), X_k = k/(count − 1)."""
        return np.exp(-0.5 * ((x[:, None] - self._centres) / self.width) ** 2)
