"""A soft rod of a kinematic tree: a Cosserat rod whose strain is a finite sum of functions."""

from collections.abc import Callable, Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from exosight.arrays import AnyArray, Number, floats, known
from exosight.errors import InputError
from exosight.mechanics.basis import Basis
from exosight.mechanics.joint import Fixed, Joint
from exosight.mechanics.quadrature import Gauss
from exosight.mechanics.section import Section

STRAINS = ("torsion_x", "bend_y", "bend_z", "stretch_x", "shear_y", "shear_z")
STRAIGHT = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
"""Strain of a straight, unloaded rod along its local x axis."""

ZANNAH = np.array([0.5 - np.sqrt(3) / 6, 0.5 + np.sqrt(3) / 6])
"""Where a Magnus step samples the strain, as fractions of its interval."""


def step_samples(points: Float[np.ndarray, " points"]) -> Float[np.ndarray, "steps 2"]:
    """The two places in each interval between neighbouring points where a Magnus step samples the strain."""
    return points[:-1, None] + np.diff(points)[:, None] * ZANNAH


class Rod(eqx.Module):
    """A Cosserat rod along its local x axis.

    name, parent   its own name, and that of the body at whose end it sits (None: the ground)
    strains        the enabled strain components with their bases, in the order of `STRAINS`
    quadrature     the points along it; each is a frame
    joint, mount   as for a link: motion of its base, and pose of the joint
    section        sizes at each point
    length         ()          [m]
    young          ()          [Pa]
    poisson        ()          [-]
    density        ()          [kg/m³]
    viscosity      ()          [Pa s]; Kelvin–Voigt: multiplies strain rates as `young` multiplies strains
    natural        (nodes, 6)  stress-free strain, at the points, then at the samples of each step [1/m; -]

    Coordinates follow strain by strain. Angular strains are natural + (1/length) Σ φ_k q_k, so that q is in
    radians, linear ones natural + Σ φ_k q_k (as in SoRoSim).
    """

    name: str = eqx.field(static=True)
    parent: str | None = eqx.field(static=True)
    strains: tuple[tuple[str, Basis], ...] = eqx.field(static=True)
    quadrature: Gauss = eqx.field(static=True)
    joint: Joint
    mount: Float[AnyArray, "4 4"]
    section: Section
    length: Float[AnyArray, ""]
    young: Float[AnyArray, ""]
    poisson: Float[AnyArray, ""]
    density: Float[AnyArray, ""]
    viscosity: Float[AnyArray, ""]
    natural: Float[AnyArray, "nodes 6"]

    def __init__(
        self,
        name: str,
        length: Number,
        section: Section,
        *,
        young: Number,
        strains: Mapping[str, Basis],
        quadrature: Gauss,
        poisson: Number = 0.5,
        density: Number = 0.0,
        viscosity: Number = 0.0,
        natural: Callable[[Float[np.ndarray, " n"]], Float[AnyArray, "n 6"]] | None = None,
        parent: str | None = None,
        joint: Joint | None = None,
        mount: Float[AnyArray, "4 4"] | None = None,
    ) -> None:
        for what, value, unit in (("length", length, "m"), ("young", young, "Pa")):
            if known(value) and not (value > 0 and np.isfinite(value)):
                raise InputError(
                    f"rod {name!r}, {what}: expected a finite number above 0 {unit}, got {value}"
                )
        if known(poisson) and not -1 < poisson <= 0.5:
            raise InputError(f"rod {name!r}, poisson: expected within (-1, 0.5], got {poisson}")
        for what, value, unit in (("density", density, "kg/m³"), ("viscosity", viscosity, "Pa s")):
            if known(value) and not 0 <= value < np.inf:
                raise InputError(f"rod {name!r}, {what}: expected finite, at least 0 {unit}, got {value}")
        unknown = set(strains) - set(STRAINS)
        if unknown or not strains:
            raise InputError(
                f"rod {name!r}, strains: expected some of {', '.join(STRAINS)}, got {[*strains]}"
            )
        if section.size != quadrature.size:
            raise InputError(
                f"rod {name!r}, section: expected sizes at {quadrature.size} points, got {section.size}"
            )
        nodes = np.concatenate([quadrature.points, step_samples(quadrature.points).ravel()])
        strain = np.tile(STRAIGHT, (len(nodes), 1)) if natural is None else natural(nodes)
        if np.shape(strain) != (len(nodes), 6) or (known(strain) and not np.all(np.isfinite(strain))):
            raise InputError(
                f"rod {name!r}, natural: expected a function from places in [0, 1] to finite strains "
                f"{(len(nodes), 6)}, got {np.shape(strain)}"
            )
        for strain_name, basis in strains.items():
            _check_basis(f"rod {name!r}, strains, {strain_name}", basis, quadrature)
        self.name, self.parent = name, parent
        self.strains = tuple((s, strains[s]) for s in STRAINS if s in strains)
        self.quadrature = quadrature
        self.joint = Fixed() if joint is None else joint
        self.mount = np.eye(4) if mount is None else floats(mount)
        self.section = section
        self.length = floats(length)
        self.young = floats(young)
        self.poisson = floats(poisson)
        self.density = floats(density)
        self.viscosity = floats(viscosity)
        self.natural = floats(strain)

    @property
    def frames(self) -> int:
        """Number of poses it contributes: one per quadrature point."""
        return self.quadrature.size

    @property
    def dofs(self) -> int:
        """Number of coordinates: those of its joint, then those of its strains."""
        return self.joint.dofs + sum(basis.size for _, basis in self.strains)

    @property
    def rows(self) -> tuple[int, ...]:
        """Indices of the enabled strains in a strain twist."""
        return tuple(STRAINS.index(name) for name, _ in self.strains)

    @property
    def scale(self) -> Float[AnyArray, " enabled"]:
        """Factor of an enabled strain: 1/length [1/m] for angular ones, 1 for linear ones."""
        return jnp.where(np.array(self.rows) < 3, 1 / self.length, 1.0)

    def functions(self, x: Float[np.ndarray, " points"]) -> Float[np.ndarray, "points enabled size"]:
        """Each enabled strain's basis functions at x in [0, 1]: ξ_enabled = scale · functions · q + ξ*."""
        values = np.zeros((len(x), len(self.strains), sum(basis.size for _, basis in self.strains)))
        start = 0
        for i, (_, basis) in enumerate(self.strains):
            values[:, i, start : start + basis.size] = basis.evaluate(x)
            start += basis.size
        return values

    def weights(self) -> Float[AnyArray, " points"]:
        """Quadrature weights over arc length [m]."""
        return self.length * self.quadrature.weights

    def mass(self) -> Float[AnyArray, " points"]:
        """Mass [kg] of each quadrature point."""
        return self.weights() * self.density * self.section.area()

    def inertia(self) -> Float[AnyArray, "points 3 3"]:
        """Moment of inertia [kg m²] of each quadrature point's mass, about itself, in its own axes."""
        rotary = (self.weights() * self.density)[:, None] * self.section.rotary()
        return rotary[:, :, None] * np.eye(3)

    def stiffness(self) -> Float[AnyArray, "size size"]:
        """K = ∫ Φᵀ Σ Φ ds, so that the elastic energy is ½ qᵀ K q."""
        return self._integrated(self.section.stiffness(self.young, self.poisson))

    def damping(self) -> Float[AnyArray, "size size"]:
        """D, so that the viscous force is D dq/dt: K with viscosity in the place of Young's modulus."""
        return self._integrated(self.section.stiffness(self.viscosity, self.poisson))

    def _integrated(self, section: Float[AnyArray, "points 6"]) -> Float[AnyArray, "size size"]:
        phi = self.functions(self.quadrature.points) * self.scale[:, None]
        density = self.weights()[:, None] * section[:, list(self.rows)]
        return jnp.einsum("pea,pe,peb->ab", phi, density, phi)


def _check_basis(what: str, basis: Basis, quadrature: Gauss) -> None:
    """InputError for an invalid basis, or functions linearly dependent at the quadrature points."""
    points, wanted = quadrature.points, (quadrature.size, basis.size)
    values = np.asarray(basis.evaluate(points))
    if values.shape != wanted or not np.all(np.isfinite(values)):
        raise InputError(
            f"{what}: expected `evaluate` to give finite values of shape {wanted}, got {values.shape}"
        )
    # Its square is the condition number of the stiffness matrix, which must be invertible.
    if (
        basis.size > np.sum(quadrature.weights > 0)
        or np.linalg.cond(np.sqrt(quadrature.weights)[:, None] * values) > 1e7
    ):
        raise InputError(
            f"{what}: expected functions that the quadrature tells apart, got {basis.size} that are nearly "
            f"dependent on its {quadrature.size} points; use fewer functions, more points or another basis"
        )
