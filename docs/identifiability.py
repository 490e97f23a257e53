"""Identifiability: the smallest contact forces that one view of `published` or `index` resolves.

An equilibrium depends on numbers p that the picture does not state: the actuation, the exosuit's radius along
its length, its length, and how stiff everything is. To first order p moves the outline in the picture by J_y
and the contact forces by J_f, so that with noise σ on every outline point and a prior covariance P of p, the
forces are known to within (Bayes, all Gaussian)

    cov(f) = J_f (J_yᵀ J_y / σ² + P⁻¹)⁻¹ J_fᵀ.

No estimator of one image, however trained, does better on average over that prior. What no outline shows at
all: load and every stiffness scaled by one factor leave the pose as it is and scale the forces.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.exosuit.assembly import QUADRATURE, Exosuit, assemble_surface
from exosight.exosuit.finger import Finger
from exosight.exosuit.index import with_surfaces
from exosight.exosuit.published import system_of
from exosight.exosuit.shapes import radius, radius_slope
from exosight.mechanics import differentiable, drive, walk
from exosight.mechanics.sensitivity import SNAP
from exosight.mechanics.surface_contact import SolidContact, contacts
from exosight.mechanics.term import Memories
from exosight.system.observation import observe_state
from exosight.system.system import System

KNOTS = 6
"""Places along the exosuit at which its radius is unknown; straight in between."""
HINGES, FORCES = len(Finger().joint_stiffness), len(Finger().sphere_radii()) - 1
"""Hinges of the finger, and contacts on it that are estimated."""
PARAMETERS = (
    "u",
    "young",
    "contact_stiffness",
    *(f"joint_stiffness_{i}" for i in range(HINGES)),
    "length",
    *(f"radius_{i}" for i in range(KNOTS)),
)
"""What is unknown: u [N]; moduli and stiffnesses [share of their value]; length and radii [m]."""

NOISE = 0.1
"""Standard deviation of an outline point across the outline [pixels]: what a sharp edge allows."""

STEP = 0.05
"""Loads are approached from rest in steps of this [N]."""

_ON_LINK = 8  # outline points on a link of the finger, one every 3 to 6 mm
OUTLINE = 2 * QUADRATURE.size + 1 + HINGES * _ON_LINK + 1
"""Outline points: two edges and a tip, one edge and a tip."""


@dataclass(frozen=True)
class Prior:
    """Standard deviations of what is unknown, before the picture is seen."""

    u: float = 2.0
    """[N]"""
    stiffness: float = 0.1
    """of modulus, contact and each hinge, as a share"""
    length: float = 0.01
    """[m]"""
    radius: float = 0.002
    """at each knot [m]"""

    def deviations(self) -> Float[np.ndarray, " parameters"]:
        """One standard deviation a parameter."""
        parts = ([self.u], [self.stiffness] * (2 + HINGES), [self.length], [self.radius] * KNOTS)
        return np.concatenate([np.asarray(part, dtype=float) for part in parts])


MATERIAL_KNOWN = Prior(stiffness=1e-6)
"""The published setting: only the exosuit's shape and its actuation differ from picture to picture."""
MATERIAL_VARIES = Prior()
"""Moduli and stiffnesses are known to 10 %."""


@dataclass(frozen=True)
class Sensitivity:
    """How outline and forces of one exosuit depend on PARAMETERS, at each load."""

    u: Float[np.ndarray, " loads"]
    """[N]"""
    forces: Float[np.ndarray, "loads outputs"]
    """on the estimated contacts [N]"""
    stable: Bool[np.ndarray, " loads"]
    """Whether the pose has derivatives: found, and not about to snap. Elsewhere these are NaN."""
    outline: Float[np.ndarray, "loads points parameters"]
    """derivatives of the outline points' shift across the outline [m a unit]"""
    force: Float[np.ndarray, "loads outputs parameters"]
    """derivatives of the forces [N a unit]"""


def sensitivity(exosuit: Exosuit, loads: Float[np.ndarray, " loads"], surfaces: bool = False) -> Sensitivity:
    """Outline and forces by PARAMETERS, at rising loads approached from rest.

    The outline is both edges and the tip of the exosuit, and the finger's lower edge and tip; a point counts
    by its shift across the outline, as one along it does not show. In `published` the exosuit covers the
    finger; in `index` both share one boundary where they touch.

    loads      (loads,)  rising, 0 or more [N]
    surfaces   of `index` instead of `published`

    Raises InputError for other loads, or a finger with another number of hinges.
    """
    loads = np.asarray(loads, dtype=float)
    if not (len(loads) and loads[0] >= 0 and np.all(np.diff(loads) > 0) and np.isfinite(loads[-1])):
        raise InputError(f"loads: expected rising numbers from 0 N, got {loads.tolist()}")
    if len(exosuit.finger.joint_stiffness) != HINGES:
        raise InputError(f"finger: expected {HINGES} hinges, got {len(exosuit.finger.joint_stiffness)}")
    grid = np.arange(STEP, loads[-1], STEP)
    path = np.union1d(np.round(grid, 9), loads)
    system = system_at(exosuit, np.zeros(len(PARAMETERS)), surfaces)
    found = drive([system.robot], path[:, None])
    at = np.searchsorted(path, loads)
    stable = np.asarray(found.converged[0, at] & (found.min_eigenvalue[0, at] > 10 * SNAP))
    return at_poses(exosuit, loads, np.asarray(found.q[0, at]), stable, surfaces)


def at_poses(
    exosuit: Exosuit,
    u: Float[np.ndarray, " poses"],
    q: Float[np.ndarray, "poses dofs"],
    stable: Bool[np.ndarray, " poses"],
    surfaces: bool,
) -> Sensitivity:
    """The same at equilibria that are known.

    u        (poses,)        [N]
    q        (poses, dofs)
    stable   (poses,)        whether the pose is one, and not about to snap
    """
    # Assembled outside of compiled code, where bodies are checked as they are made.
    system = system_at(exosuit, np.zeros(len(PARAMETERS)), surfaces)
    slopes = jax.jacfwd(lambda p: system_at(exosuit, p, surfaces))(jnp.zeros(len(PARAMETERS)))
    forces = np.full((len(u), FORCES), np.nan)
    outline = np.full((len(u), OUTLINE, len(PARAMETERS)), np.nan)
    force = np.full((len(u), FORCES, len(PARAMETERS)), np.nan)
    for k in np.flatnonzero(stable):
        (outline[k], force[k]), forces[k] = _derivatives(system, slopes, u[k], q[k])
    return Sensitivity(u, forces, stable, outline, force)


def resolved(
    of: Sensitivity, prior: Prior = MATERIAL_KNOWN, noise: float = NOISE, metres_per_pixel: float = 0.0011
) -> Float[np.ndarray, "loads forces"]:
    """Standard deviations of the estimated contacts and of F_net that remain once a picture is seen [N].

    NaN where a contact is free, or the pose has no derivatives.

    noise   of an outline point [pixels]; infinite for what is known without a picture

    Raises InputError for a noise that is not above 0.
    """
    if not noise > 0:
        raise InputError(f"noise: expected above 0 pixels, got {noise}")
    scale = prior.deviations()
    out = np.full((len(of.u), FORCES + 1), np.nan)
    for k in np.flatnonzero(of.stable):
        # In units of the prior's deviations, whose own information then is the identity.
        seen = of.outline[k] * scale / (noise * metres_per_pixel)
        force = np.vstack([of.force[k], of.force[k].sum(axis=0)]) * scale
        # By singular values: squaring the outline's derivatives would lose half of their digits.
        _, size, directions = np.linalg.svd(seen, full_matrices=True)
        strength = np.zeros(len(scale))
        strength[: len(size)] = size
        along = force @ directions.T / np.sqrt(1 + strength**2)
        out[k] = np.linalg.norm(along, axis=1)
        out[k, np.append(of.forces[k], of.forces[k].sum()) == 0] = np.nan
    return out


def system_at(exosuit: Exosuit, p: Float[AnyArray, " parameters"], surfaces: bool) -> System:
    """The system whose PARAMETERS differ by p from the exosuit's own (u aside)."""
    _, young, contact, *rest = p
    joints, length, radii = rest[:HINGES], rest[HINGES], jnp.stack(rest[HINGES + 1 :])
    x = QUADRATURE.points
    hats, slopes = _hats(x)
    robot = assemble_surface(
        radius(exosuit.shape.surface, x) + hats @ radii,
        radius_slope(exosuit.shape.surface, x) + slopes @ radii,
        exosuit.shape.length + length,
        exosuit,
    )
    system = system_of(robot, exosuit.finger)
    system = with_surfaces(system, exosuit) if surfaces else system

    def stiffnesses(of: System) -> list[Any]:
        rod, *links = of.bodies
        return [rod.young, *(link.joint.stiffness for link in links[:HINGES]), *_contact_stiffness(of)]

    shares = (young, *joints, *[contact] * len(system.contacts))
    scaled = [jnp.asarray(k * (1 + share)) for k, share in zip(stiffnesses(system), shares, strict=True)]
    return eqx.tree_at(stiffnesses, system, scaled)


def _contact_stiffness(of: System) -> list[Any]:
    return [contact.stiffness for contact in of.contacts]


def _hats(
    x: Float[np.ndarray, " points"],
) -> tuple[Float[np.ndarray, "points knots"], Float[np.ndarray, "points knots"]]:
    """Piecewise linear functions, 1 at one knot and 0 at the others, and their slopes."""
    knots = np.linspace(0, 1, KNOTS)
    hats = np.stack([np.interp(x, knots, row) for row in np.eye(KNOTS)], axis=1)
    left = np.minimum((x * (KNOTS - 1)).astype(int), KNOTS - 2)
    slopes = (KNOTS - 1) * (np.eye(KNOTS)[left + 1] - np.eye(KNOTS)[left])
    return hats, slopes


def measured(
    system: System, q: Float[AnyArray, " dofs"], history: Memories = ()
) -> tuple[Float[Array, "points 2"], Float[Array, "points 2"], Float[Array, " forces"]]:
    """Points of the outline [m], unit vectors across it, held constant in derivatives, and the forces [N].

    history   of the state, see `Equilibria`
    """
    observed = observe_state(system, jnp.asarray(q), history)
    axis = observed.axes["exosuit"][:, ::2]
    along, across = _directions(jnp.asarray(jnp.gradient(axis, QUADRATURE.points, axis=0)))
    thick = next(tube.radius for tube in system.tubes if tube.name == "exosuit")
    edge = jnp.asarray(thick)[:, None] * across
    lower, below = _lower_edge(system, jnp.asarray(q), axis - edge, across)
    # The link beyond the last hinge is the fingertip's cap.
    nodes = observed.axes["finger"][: HINGES + 1, ::2]
    share = (np.arange(_ON_LINK)[:, None, None] + 0.5) / _ON_LINK
    points = nodes[:-1] + share * jnp.diff(nodes, axis=0)
    link_along, link_across = _directions(jnp.diff(nodes, axis=0))
    of_links = jnp.broadcast_to(link_across, points.shape).reshape(-1, 2)
    places = (axis + edge, lower, axis[-1:], points.reshape(-1, 2), nodes[-1:])
    directions = (across, below, along[-1:], of_links, link_along[-1:])
    outputs = np.array(system.schema.output_indices())
    return jnp.concatenate(places), jnp.concatenate(directions), jnp.asarray(observed.readings)[outputs]


def _lower_edge(
    system: System, q: Float[Array, " dofs"], free: Float[Array, "points 2"], across: Float[Array, "points 2"]
) -> tuple[Float[Array, "points 2"], Float[Array, "points 2"]]:
    """That of the exosuit: free, or where a picture in depth order shows the boundary with the finger."""
    robot = system.robot
    press = robot.terms[1]
    if not isinstance(press, SolidContact):
        return free, across
    motion = walk(robot, q)
    centres, own = motion.position[press.first.frames(robot)], press.first.radius
    nearest = contacts(press.second, motion.pose[press.second.index(robot)], centres, own).touches[0]
    # Spheres of radii r₁, r₂ with centres D apart meet at (D² + r₁² − r₂²)/2D from the first centre.
    other = nearest.distance + nearest.overlap - own
    deep = (nearest.distance**2 + own**2 - other**2) / (2 * nearest.distance)
    shared = centres - deep[:, None] * nearest.normal
    touching = nearest.overlap[:, None] > 0
    normal = jax.lax.stop_gradient(nearest.normal)
    return jnp.where(touching, shared[:, ::2], free), jnp.where(touching, normal[:, ::2], across)


def _directions(
    tangent: Float[Array, "points 2"],
) -> tuple[Float[Array, "points 2"], Float[Array, "points 2"]]:
    """Unit vectors along and across a curve, held constant: shifts are against the reference."""
    unit = jax.lax.stop_gradient(tangent / jnp.linalg.norm(tangent, axis=1, keepdims=True))
    return unit, jnp.stack([-unit[:, 1], unit[:, 0]], axis=1)


@partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})  # compiled in a tenth of the time
def _derivatives(
    system: System, slopes: System, u: Float[AnyArray, ""], q: Float[AnyArray, " dofs"]
) -> tuple[
    tuple[Float[Array, "points parameters"], Float[Array, "forces parameters"]], Float[Array, " forces"]
]:
    """Derivatives of outline and forces by PARAMETERS, and the forces.

    slopes   derivatives of the system's numbers, along a last axis
    """

    def at(p: Array) -> tuple[tuple[Array, Array], Array]:
        own = jax.tree.map(lambda leaf, slope: leaf + slope @ p, system, slopes)
        points, across, forces = measured(own, differentiable(own.robot, (u + p[0])[None], q))
        return (jnp.sum(across * points, axis=1), forces), forces

    return jax.jacfwd(at, has_aux=True)(jnp.zeros(len(PARAMETERS)))
