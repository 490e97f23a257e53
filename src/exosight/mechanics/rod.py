"""A soft rod of a kinematic tree: a Cosserat rod whose strain is a finite sum of functions."""

from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.mechanics.basis import Basis
from exosight.mechanics.joint import Fixed, Joint
from exosight.mechanics.quadrature import Gauss
from exosight.mechanics.section import circular_mass, circular_stiffness

STRAINS = ("torsion_x", "bend_y", "bend_z", "stretch_x", "shear_y", "shear_z")
STRAIGHT = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
"""Strain of a straight, unloaded rod along its local x axis."""


class Rod(eqx.Module):
    """A rod of round section along its local x axis.

    name, parent   its own name, and that of the body at whose end it sits (None: the ground)
    strains        the enabled strain components with their bases, in the order of `STRAINS`
    quadrature     the points along it; each is a frame
    joint, mount   as for a link: how its base moves, and where that is
    length         ()         [m]
    radius         (points,)  [m]
    young          ()         [Pa]
    poisson        ()         [-]
    density        ()         [kg/m³]

    Coordinates follow strain by strain. Angular strains are (1/length) Σ φ_k q_k, so that q is in
    radians, linear ones Σ φ_k q_k (as in SoRoSim).
    """

    name: str = eqx.field(static=True)
    parent: str | None = eqx.field(static=True)
    strains: tuple[tuple[str, Basis], ...] = eqx.field(static=True)
    quadrature: Gauss = eqx.field(static=True)
    joint: Joint
    mount: Float[Array, "4 4"]
    length: Float[Array, ""]
    radius: Float[Array, " points"]
    young: Float[Array, ""]
    poisson: Float[Array, ""]
    density: Float[Array, ""]

    def __init__(
        self,
        name: str,
        length: float,
        radius: Float[AnyArray, " points"],
        *,
        young: float,
        strains: Mapping[str, Basis],
        quadrature: Gauss,
        poisson: float = 0.5,
        density: float = 0.0,
        parent: str | None = None,
        joint: Joint | None = None,
        mount: Float[AnyArray, "4 4"] | None = None,
    ) -> None:
        for what, value, unit in (("length", length, "m"), ("young", young, "Pa")):
            if not (value > 0 and np.isfinite(value)):
                raise InputError(
                    f"rod {name!r}, {what}: expected a finite number above 0 {unit}, got {value}"
                )
        if not -1 < poisson <= 0.5:
            raise InputError(f"rod {name!r}, poisson: expected within (-1, 0.5], got {poisson}")
        if not 0 <= density < np.inf:
            raise InputError(f"rod {name!r}, density: expected finite, at least 0 kg/m³, got {density}")
        unknown = set(strains) - set(STRAINS)
        if unknown or not strains:
            raise InputError(
                f"rod {name!r}, strains: expected some of {', '.join(STRAINS)}, got {[*strains]}"
            )
        radii = np.asarray(radius, dtype=float)
        if radii.shape != (quadrature.size,):
            raise InputError(
                f"rod {name!r}, radius: expected one for each of {quadrature.size} points, got {radii.shape}"
            )
        if not (np.all(radii > 0) and np.all(np.isfinite(radii))):
            raise InputError(f"rod {name!r}, radius: expected finite numbers above 0 m, got {radii.min()}")
        self.name, self.parent = name, parent
        self.strains = tuple((s, strains[s]) for s in STRAINS if s in strains)
        self.quadrature = quadrature
        self.joint = Fixed() if joint is None else joint
        self.mount = jnp.eye(4) if mount is None else jnp.asarray(mount, dtype=float)
        self.length = jnp.asarray(length, dtype=float)
        self.radius = jnp.asarray(radii)
        self.young = jnp.asarray(young, dtype=float)
        self.poisson = jnp.asarray(poisson, dtype=float)
        self.density = jnp.asarray(density, dtype=float)

    @property
    def frames(self) -> int:
        """Number of poses it contributes: one a quadrature point."""
        return self.quadrature.size

    @property
    def dofs(self) -> int:
        """Number of coordinates: those of its joint, then those of its strains."""
        return self.joint.dofs + sum(basis.size for _, basis in self.strains)

    @property
    def rows(self) -> tuple[int, ...]:
        """Where the enabled strains stand in a strain twist."""
        return tuple(STRAINS.index(name) for name, _ in self.strains)

    @property
    def scale(self) -> Float[Array, " enabled"]:
        """What an enabled strain is multiplied with: 1/length [1/m] for angular ones, 1 for linear ones."""
        return jnp.where(np.array(self.rows) < 3, 1 / self.length, 1.0)

    def functions(self, x: Float[np.ndarray, " points"]) -> Float[np.ndarray, "points enabled size"]:
        """Each enabled strain's basis functions at x in [0, 1]: ξ_enabled = scale · functions · q + ξ*."""
        values = np.zeros((len(x), len(self.strains), sum(basis.size for _, basis in self.strains)))
        start = 0
        for i, (_, basis) in enumerate(self.strains):
            values[:, i, start : start + basis.size] = basis.evaluate(x)
            start += basis.size
        return values

    def weights(self) -> Float[Array, " points"]:
        """Quadrature weights over arc length [m]."""
        return self.length * self.quadrature.weights

    def section_stiffness(self) -> Float[Array, "points 6"]:
        """Diagonal section stiffness at the quadrature points [N m², N]."""
        return circular_stiffness(self.radius, self.young, self.poisson)

    def mass(self) -> Float[Array, " points"]:
        """Mass [kg] that each quadrature point carries."""
        return self.weights() * circular_mass(self.radius, self.density)

    def stiffness(self) -> Float[Array, "size size"]:
        """K = ∫ Φᵀ Σ Φ ds, so that the elastic energy is ½ qᵀ K q."""
        phi = self.functions(self.quadrature.points) * self.scale[:, None]
        density = self.weights()[:, None] * self.section_stiffness()[:, list(self.rows)]
        return jnp.einsum("pea,pe,peb->ab", phi, density, phi)
