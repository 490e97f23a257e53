"""Cross-sections of rods: areas and moments from dimensions.

Dimensions are given at each quadrature point of a rod, so they may vary along it. A new section is a class
with `area`, `moments` and `torsion`.
"""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight.arrays import AnyArray, floats, known
from exosight.errors import InputError

Scalar = Float[AnyArray, ""]
Points = Float[AnyArray, " points"]


class Section(eqx.Module):
    """The section of a rod in the plane of its local y and z axes, at each quadrature point."""

    @abstractmethod
    def area(self) -> Points:
        """A [m²]."""

    @abstractmethod
    def moments(self) -> tuple[Points, Points]:
        """Second moments of area [m⁴]: I_y = ∫ z² dA, against bending about y, and I_z = ∫ y² dA."""

    @abstractmethod
    def torsion(self) -> Points:
        """Saint-Venant's torsion constant J [m⁴]."""

    @property
    def size(self) -> int:
        """Number of points."""
        return self.area().shape[-1]

    def stiffness(self, young: Scalar, poisson: Scalar) -> Float[Array, "points 6"]:
        """Diagonal of Σ in wrench = Σ (ξ − ξ*): (GJ, EI_y, EI_z, EA, GA, GA) with G = E / 2(1 + ν).

        young     ()            [Pa]
        poisson   ()            [-]
        returns   (points, 6)   torsion and bending [N m²], then stretch and shear [N]

        Shear has no correction factor, as in the paper's toolbox.
        Source: Mathew et al., SoRoSim, doi 10.1109/MRA.2022.3202488.
        """
        shear = young / (2 * (1 + poisson))
        (y, z), area = self.moments(), self.area()
        return jnp.stack(
            [shear * self.torsion(), young * y, young * z, young * area, shear * area, shear * area], axis=-1
        )

    def rotary(self) -> Float[Array, "points 3"]:
        """Polar and both second moments [m⁴]: times density, the rotary inertia of unit length."""
        y, z = self.moments()
        return jnp.stack([y + z, y, z], axis=-1)


class Circular(Section):
    """A disc.

    radius    (points,)   [m]
    """

    radius: Points

    def __init__(self, radius: Float[AnyArray, " points"]) -> None:
        self.radius = _positive("Circular", "radius", radius)

    def area(self) -> Points:
        """πr²."""
        return np.pi * self.radius**2

    def moments(self) -> tuple[Points, Points]:
        """πr⁴/4, twice."""
        moment = self.area() * self.radius**2 / 4
        return moment, moment

    def torsion(self) -> Points:
        """πr⁴/2."""
        return self.area() * self.radius**2 / 2


class Elliptic(Section):
    """An ellipse with its axes along y and z.

    semi_y, semi_z   (points,)   semi-axes [m]
    """

    semi_y: Points
    semi_z: Points

    def __init__(self, semi_y: Float[AnyArray, " points"], semi_z: Float[AnyArray, " points"]) -> None:
        self.semi_y, self.semi_z = _same_points(
            _positive("Elliptic", "semi_y", semi_y), _positive("Elliptic", "semi_z", semi_z)
        )

    def area(self) -> Points:
        """πab."""
        return np.pi * self.semi_y * self.semi_z

    def moments(self) -> tuple[Points, Points]:
        """πab³/4 about y, πa³b/4 about z."""
        return self.area() * self.semi_z**2 / 4, self.area() * self.semi_y**2 / 4

    def torsion(self) -> Points:
        """πa³b³/(a² + b²)."""
        a, b = self.semi_y, self.semi_z
        return np.pi * (a * b) ** 3 / (a**2 + b**2)


class Rectangular(Section):
    """A rectangle with its sides along y and z.

    width    (points,)   along y [m]
    height   (points,)   along z [m]
    """

    width: Points
    height: Points

    def __init__(self, width: Float[AnyArray, " points"], height: Float[AnyArray, " points"]) -> None:
        self.width, self.height = _same_points(
            _positive("Rectangular", "width", width), _positive("Rectangular", "height", height)
        )

    def area(self) -> Points:
        """wh."""
        return self.width * self.height

    def moments(self) -> tuple[Points, Points]:
        """wh³/12 about y, w³h/12 about z."""
        return self.area() * self.height**2 / 12, self.area() * self.width**2 / 12

    def torsion(self) -> Points:
        """ab³ (1/3 − 64 b/(π⁵ a) Σ tanh(nπa/2b)/n⁵) with odd n, a ≥ b: 0.1406 a⁴ for a square.

        Source: Timoshenko and Goodier, Theory of Elasticity, 3rd ed., art. 109.
        """
        long, short = jnp.maximum(self.width, self.height), jnp.minimum(self.width, self.height)
        # Σ tanh/n⁵ = Σ 1/n⁵ − Σ (1 − tanh)/n⁵: the first sum is known, and four terms of the second are exact
        # to round-off, where direct summation needs hundreds.
        n = np.arange(1, 8, 2)
        missing = jnp.sum((1 - jnp.tanh(n * np.pi / 2 * (long / short)[..., None])) / n**5, axis=-1)
        return long * short**3 * (1 / 3 - 64 / np.pi**5 * short / long * (_ODD_FIFTH_POWERS - missing))


_ODD_FIFTH_POWERS = 31 / 32 * 1.0369277551433699
"""1 + 1/3⁵ + 1/5⁵ + …, 31/32 of Riemann's ζ(5)."""


def _positive(section: str, name: str, value: Float[AnyArray, " points"]) -> Points:
    if not known(value):
        return floats(value)
    numbers = np.asarray(value, dtype=float)
    if numbers.ndim != 1 or not (np.all(numbers > 0) and np.all(np.isfinite(numbers))):
        shown = numbers.min() if numbers.ndim == 1 and numbers.size else f"shape {numbers.shape}"
        raise InputError(
            f"{section} {name}: expected finite numbers above 0 m, one a point, got {shown}; "
            "give an array over the rod's quadrature points"
        )
    return floats(value)


def _same_points(first: Points, second: Points) -> tuple[Points, Points]:
    if first.shape != second.shape:
        raise InputError(f"section: expected both at the same points, got {first.shape}, {second.shape}")
    return first, second
