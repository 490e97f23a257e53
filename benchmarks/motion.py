"""A rod released under its weight: by exosight and by SoRoMoX, on the same strains, points and damping."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from soromox.systems import GVS, GVSSegment, JointSpec, LinkSpec, StrainBasisSpec, SystemState
from soromox.utils.integration import gauss_quadrature

from benchmarks.planar import DENSITY, LENGTH
from exosight.mechanics import Circular, Gauss, Gravity, Legendre, MotionOptions, Robot, Rod, evolve

POINTS, DEGREE = 8, 2
"""Gauss points along the rod, degree of each strain's polynomial."""
POISSON = 0.5 - 1e-9
"""SoRoMoX refuses ½, and its viscosity of shear is Young's over 3 only there."""
TIMES = np.linspace(0, 0.5, 11)
"""When both report their coordinates [s]."""

NAMES = {
    "torsion_x": "kappa_x",
    "bend_y": "kappa_y",
    "bend_z": "kappa_z",
    "stretch_x": "sigma_x",
    "shear_y": "sigma_y",
    "shear_z": "sigma_z",
}
"""Our strains and theirs."""


@dataclass(frozen=True)
class Case:
    """What may deform, the rod's curvature in the horizontal plane without load [1/m], and its radius [m].

    Young's modulus and viscosity grow as the radius shrinks, so that every radius bends and moves alike:
    1 MPa and 300 Pa s at 1 cm.
    """

    strains: tuple[str, ...]
    curvature: float
    radius: float

    @property
    def young(self) -> float:
        """[Pa]"""
        return 1e6 * (0.01 / self.radius) ** 2

    @property
    def viscosity(self) -> float:
        """Young's [Pa s]: 0.3 ms times Young's modulus."""
        return 3e-4 * self.young

    @property
    def natural(self) -> list[float]:
        """Strain without load, in our order and theirs."""
        return [0.0, 0.0, self.curvature, 1.0, 0.0, 0.0]


PLANE = Case(("bend_y", "stretch_x"), 0.0, 0.01)
"""A straight rod that bends and stretches: 6 degrees of freedom."""
SPACE = Case(tuple(NAMES), 5.0, 0.01)
"""An arc of 1.5 rad with all strains, so that its weight bends, twists and shears it: 18 of them."""
SLENDER = Case(tuple(NAMES), 5.0, 0.005)
"""The same, half as thick: it moves alike, but its shear is twelve times as stiff to explicit steps."""

GRAVITY = np.array([0.0, 0.0, -9.81])
"""[m/s²]"""


class TheirPoints(Gauss):
    """SoRoMoX's Gauss points: they stop converging at single precision, some 5e-8 from the true ones."""

    def _rule(self) -> tuple[np.ndarray, np.ndarray]:
        with jax.ensure_compile_time_eval():
            points, weights, _ = gauss_quadrature(self.per_element)
        return np.array(points), np.array(weights)


@cache
def our_robot(case: Case) -> Robot:
    """One rod and its weight, on SoRoMoX's points. Built once, as SoRoMoX's is."""
    points = TheirPoints(1, POINTS)
    rod = Rod(
        "rod",
        LENGTH,
        Circular(np.full(points.size, case.radius)),
        young=case.young,
        poisson=POISSON,
        density=DENSITY,
        viscosity=case.viscosity,
        strains=dict.fromkeys(case.strains, Legendre(DEGREE)),
        quadrature=points,
        natural=lambda places: np.tile(case.natural, (len(places), 1)),
    )
    return Robot((rod,), (Gravity(jnp.asarray(GRAVITY)),))


@dataclass(frozen=True)
class Exosight:
    """Our motion, with steps that follow a tolerance [m] or fixed ones [s]."""

    case: Case
    tolerance: float = 1e-7
    step: float | None = None

    def __call__(self) -> Float[np.ndarray, "times dofs"]:
        """Integrate from rest."""
        options = MotionOptions(tolerance=self.tolerance, step=self.step, lanes=1)
        found = evolve([our_robot(self.case)], TIMES, options=options)
        if not found.converged.all():
            raise RuntimeError("exosight gave up")
        return np.asarray(found.q[0])


@cache
def their_rollout(case: Case, step: float) -> Callable[[], Float[np.ndarray, "times dofs"]]:
    """SoRoMoX's motion by its default, Tsit5 with fixed steps [s], compiled at the first call.

    Same strains, points, stiffness and damping, so that its coordinates are ours. Its viscosity is that of
    shear, a third of Young's.
    """
    link = LinkSpec.circular(
        length=LENGTH,
        radius=case.radius,
        density=DENSITY,
        reference_strain=case.natural,
        young_modulus=case.young,
        poisson_ratio=POISSON,
        material_damping_coefficient=case.viscosity / 3,
    )
    basis = StrainBasisSpec("legendre", tuple(NAMES[name] for name in case.strains), DEGREE)
    system = GVS.from_segments(
        [GVSSegment(link, JointSpec.fixed(), basis, POINTS)],
        gravity=jnp.asarray(GRAVITY),
        base_pose=jnp.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
        scale_rotational_basis_by_length=True,
    )
    dofs = system.num_internal_dofs
    start = SystemState(t=jnp.array(0.0), y=jnp.zeros(2 * dofs))
    options = {"t1": TIMES[-1], "save_ts": TIMES, "solver": diffrax.Tsit5(), "solver_dt": step}
    compiled = jax.jit(lambda state: system.rollout_to(state, **options).y)
    return lambda: np.asarray(compiled(start))[:, :dofs]
