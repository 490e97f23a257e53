"""Identifiability: the smallest contact forces that one view of the published system resolves.

An equilibrium depends on numbers p that the picture does not state: the actuation, the exosuit's radius along
its length, its length, and how stiff everything is. To first order p moves the outline in the picture by J_y
and the contact forces by J_f, so that with noise σ on every outline point and a prior covariance P of p, the
forces are known to within (Bayes, all Gaussian)

    cov(f) = J_f (J_yᵀ J_y / σ² + P⁻¹)⁻¹ J_fᵀ.

No estimator of one image, however trained, does better on average over that prior. What no outline shows at
all: load and every stiffness scaled by one factor leave the pose as it is and scale the forces.
"""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.exosuit.assembly import QUADRATURE, ROD, Exosuit, assemble_surface
from exosight.exosuit.finger import Finger
from exosight.exosuit.published import system_of
from exosight.exosuit.shapes import radius, radius_slope
from exosight.mechanics import Robot, differentiable, drive
from exosight.mechanics.sensitivity import SNAP
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


def sensitivity(exosuit: Exosuit, loads: Float[np.ndarray, " loads"]) -> Sensitivity:
    """Outline and forces by PARAMETERS, at rising loads approached from rest.

    The outline is both edges and the tip of the exosuit, which covers the finger, and the finger's lower edge
    and tip; a point counts by its shift across the outline, as one along it does not show.

    loads   (loads,)  rising, 0 or more [N]

    Raises InputError for other loads, or a finger with another number of hinges.
    """
    loads = np.asarray(loads, dtype=float)
    if not (len(loads) and loads[0] >= 0 and np.all(np.diff(loads) > 0) and np.isfinite(loads[-1])):
        raise InputError(f"loads: expected rising numbers from 0 N, got {loads.tolist()}")
    if len(exosuit.finger.joint_stiffness) != HINGES:
        raise InputError(f"finger: expected {HINGES} hinges, got {len(exosuit.finger.joint_stiffness)}")
    grid = np.arange(STEP, loads[-1], STEP)
    path = np.union1d(np.round(grid, 9), loads)
    # Assembled outside of compiled code, where bodies are checked as they are made.
    system = _system(exosuit, np.zeros(len(PARAMETERS)))
    slopes = jax.jacfwd(lambda p: _system(exosuit, p))(jnp.zeros(len(PARAMETERS)))
    found = drive([system.robot], path[:, None])
    at = np.searchsorted(path, loads)
    stable = np.asarray(found.converged[0, at] & (found.min_eigenvalue[0, at] > 10 * SNAP))
    forces = np.full((len(loads), FORCES), np.nan)
    outline = np.full((len(loads), OUTLINE, len(PARAMETERS)), np.nan)
    force = np.full((len(loads), FORCES, len(PARAMETERS)), np.nan)
    for k in np.flatnonzero(stable):
        (outline[k], force[k]), forces[k] = _derivatives(system, slopes, loads[k], found.q[0, at[k]])
    return Sensitivity(loads, forces, stable, outline, force)


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


def _system(exosuit: Exosuit, p: Float[AnyArray, " parameters"]) -> System:
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

    def stiffnesses(of: Robot) -> list[Any]:
        links = [of[exosuit.finger.link_name(i)] for i in range(HINGES)]
        return [of[ROD].young, of.terms[1].stiffness, *(link.joint.stiffness for link in links)]

    scaled = [
        jnp.asarray(k * (1 + share))
        for k, share in zip(stiffnesses(robot), (young, contact, *joints), strict=True)
    ]
    return system_of(eqx.tree_at(stiffnesses, robot, scaled), exosuit.finger)


def _hats(
    x: Float[np.ndarray, " points"],
) -> tuple[Float[np.ndarray, "points knots"], Float[np.ndarray, "points knots"]]:
    """Piecewise linear functions, 1 at one knot and 0 at the others, and their slopes."""
    knots = np.linspace(0, 1, KNOTS)
    hats = np.stack([np.interp(x, knots, row) for row in np.eye(KNOTS)], axis=1)
    left = np.minimum((x * (KNOTS - 1)).astype(int), KNOTS - 2)
    slopes = (KNOTS - 1) * (np.eye(KNOTS)[left + 1] - np.eye(KNOTS)[left])
    return hats, slopes


def _measured(
    system: System, q: Float[Array, " dofs"]
) -> tuple[Float[Array, " points"], Float[Array, " forces"]]:
    """Shift of the outline points across the reference outline, up to a constant [m], and the forces [N]."""
    observed = observe_state(system, q)
    axis = observed.axes["exosuit"][:, ::2]
    along, across = _directions(jnp.asarray(jnp.gradient(axis, QUADRATURE.points, axis=0)))
    shift = jnp.sum(across * axis, axis=1)
    thick = next(tube.radius for tube in system.tubes if tube.name == "exosuit")
    # The link beyond the last hinge is the fingertip's cap.
    nodes = observed.axes["finger"][: HINGES + 1, ::2]
    share = (np.arange(_ON_LINK)[:, None, None] + 0.5) / _ON_LINK
    points = nodes[:-1] + share * jnp.diff(nodes, axis=0)
    link_along, link_across = _directions(jnp.diff(nodes, axis=0))
    outline = (
        *(shift + thick, shift - thick, along[-1:] @ axis[-1]),
        *(jnp.sum(link_across * points, axis=2).ravel(), link_along[-1:] @ nodes[-1]),
    )
    return jnp.concatenate(outline), jnp.asarray(observed.readings)[np.array(system.schema.output_indices())]


def _directions(
    tangent: Float[Array, "points 2"],
) -> tuple[Float[Array, "points 2"], Float[Array, "points 2"]]:
    """Unit vectors along and across a curve, held constant: shifts are against the reference."""
    unit = jax.lax.stop_gradient(tangent / jnp.linalg.norm(tangent, axis=1, keepdims=True))
    return unit, jnp.stack([-unit[:, 1], unit[:, 0]], axis=1)


@jax.jit
def _derivatives(
    system: System, slopes: System, u: Float[AnyArray, ""], q: Float[AnyArray, " dofs"]
) -> tuple[
    tuple[Float[Array, "points parameters"], Float[Array, "forces parameters"]], Float[Array, " forces"]
]:
    """Derivatives of outline and forces by PARAMETERS, and the forces.

    slopes   derivatives of the system's numbers, along a last axis
    """

    def measured(p: Array) -> tuple[tuple[Array, Array], Array]:
        own = jax.tree.map(lambda leaf, slope: leaf + slope @ p, system, slopes)
        outline, forces = _measured(own, differentiable(own.robot, (u + p[0])[None], q))
        return (outline, forces), forces

    return jax.jacfwd(measured, has_aux=True)(jnp.zeros(len(PARAMETERS)))
