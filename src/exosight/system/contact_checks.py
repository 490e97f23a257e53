"""What the parts of a contact must be before it can be solved: sizes, stiffness, and apart at rest."""

from collections.abc import Mapping
from itertools import accumulate
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from exosight.arrays import known
from exosight.errors import InputError
from exosight.mechanics.contact import SphereContact, Spheres
from exosight.mechanics.rigid_contact import RigidContact
from exosight.mechanics.rod import Rod
from exosight.mechanics.surface_contact import SolidContact
from exosight.mechanics.surfaces import Plane, Solids, Tube, line_stiffness
from exosight.mechanics.tree import Tree
from exosight.mechanics.tube_contact import TubeContact
from exosight.mechanics.tube_distance import FAR

STIFFEST = 1000.0
"""Largest stiffness, in that of the rod's material. On the controller's exosuit of `index` and of `published`
forces change by less than 0.2 % from 30 times on, 1000 times takes 8 and 21 times the solver's steps, and at
10⁶ and 10⁵ times it finds no pose."""

OVERLAP = 0.5
"""Largest overlap at rest, in the smaller radius. Shapes of `published` reach 0.22; from 1 on, an axis is
inside the other surface, and forces may point to either side."""

SAMPLES = 33
"""Spheres that stand for a solid."""


ContactTerm = SphereContact | SolidContact | TubeContact | RigidContact


class Balls(NamedTuple):
    """Spheres of a surface at rest: centres (balls, 3) and radii (balls,) [m]."""

    centre: Float[np.ndarray, "balls 3"]
    radius: Float[np.ndarray, " balls"]


def check_contacts(terms: Mapping[str, ContactTerm], tree: Tree) -> None:
    """InputError, beginning with its place, for a contact that cannot be solved or whose surfaces overlap.

    terms   by their places
    """
    if not terms or not all(known(leaf) for leaf in jax.tree.leaves((terms, tree))):
        return
    pose = rest_poses(tree)
    for place, term in terms.items():
        for side in (term.first, term.second):
            _check_sizes(place, side)
        stiffness, largest = float(term.stiffness), _stiffest(term, tree)
        if not 0 < stiffness <= largest:
            most = f" and at most {largest:.3g}, {STIFFEST:g} times that of the rod"
            raise InputError(
                f"{place}: expected a stiffness above 0{most * bool(largest < np.inf)}, got {stiffness:g}; "
                "forces do not change any more long before, but the solver needs more and more steps"
            )
        gap, radius = _gaps(term, _balls(term.first, tree, pose), tree, pose)
        worst = np.argmin(gap + OVERLAP * radius)
        overlap, allowed = -1e3 * gap.flat[worst], 1e3 * OVERLAP * radius.flat[worst]
        if overlap > allowed:
            raise InputError(
                f"{place}: expected surfaces that overlap at rest by at most half their radius, "
                f"here {allowed:.3g} mm, got {overlap:.3g} mm; move them apart"
            )


def rest_poses(tree: Tree) -> Float[np.ndarray, "frames 4 4"]:
    """Poses of all frames without loads, all joints at 0, to some 1e-3 of a pre-curved rod's length."""
    ends: dict[str | None, np.ndarray] = {None: np.eye(4)}
    poses = []
    for body in tree.bodies:
        start = ends[body.parent] @ np.asarray(body.mount)
        if isinstance(body, Rod):
            points = body.quadrature.points
            strain = np.asarray(body.natural)[: len(points)]
            twist = float(body.length) * np.diff(points)[:, None] * (strain[1:] + strain[:-1]) / 2
            steps = np.zeros((len(twist), 4, 4))
            steps[:, :3, :3] = np.cross(twist[:, None, :3], np.eye(3)).swapaxes(1, 2)
            steps[:, :3, 3] = twist[:, 3:]
            # The exponentials' series; their angles are small.
            moved = np.eye(4) + steps @ (np.eye(4) + steps @ (np.eye(4) + steps / 3) / 2)
            pose = list(accumulate(moved, np.matmul, initial=start))
            end = pose[-1]
        else:
            offsets = np.tile(np.eye(4), (body.frames + 1, 1, 1))
            offsets[:-1, :3, 3] = body.sites
            offsets[-1, 0, 3] = body.length
            *pose, end = start @ offsets
        poses += pose
        ends[body.name] = end
    return np.array(poses)


def _check_sizes(place: str, side: Tube | Solids | Plane | Spheres) -> None:
    """InputError for radii, lengths or normals that make no surface."""
    if isinstance(side, Plane):
        if not np.isfinite(side.normal).all() or not np.any(side.normal):
            raise InputError(f"{place}: expected a normal of the plane, such as 0, 0, 1, got {side.normal}")
        return
    radius = np.asarray(side.radius)
    if not (radius > 0).all() or not np.isfinite(radius).all():
        raise InputError(f"{place}: expected radii above 0 m, got {radius.min():g}")
    if isinstance(side, Solids):
        length, taper = np.asarray(side.length), np.abs(radius[:, 0] - radius[:, 1])
        short = np.argmin(length - taper)
        if not length[short] > taper[short]:
            raise InputError(
                f"{place}: expected links longer than their radii differ, else one end holds the other, got "
                f"{side.frames[short][0]}, {1e3 * length[short]:g} mm long, with radii that differ by "
                f"{1e3 * taper[short]:g} mm"
            )


def _stiffest(term: ContactTerm, tree: Tree) -> float:
    """Largest stiffness of a contact: of rods that of the line, of spheres on rods that of a radius of it."""
    if isinstance(term, SphereContact):
        names = {body for side in (term.first, term.second) for body, _ in side.frames}
        radius = float(np.mean(term.first.radius))
    elif isinstance(term, RigidContact):
        return np.inf
    else:
        names = {side.rod for side in (term.first, term.second) if isinstance(side, Tube)}
        radius = 1.0
    rods = [body for body in tree.bodies if isinstance(body, Rod) and body.name in names]
    lines = [line_stiffness(float(rod.young), float(rod.poisson)) for rod in rods]
    return STIFFEST * radius * min(lines, default=np.inf)


def _balls(side: Tube | Solids | Spheres, tree: Tree, pose: np.ndarray) -> Balls:
    """The surface as spheres."""
    if isinstance(side, Tube):
        return Balls(pose[side.frames(tree), :3, 3], np.asarray(side.radius))
    if isinstance(side, Spheres):
        return Balls(pose[list(side.index(tree)), :3, 3], np.asarray(side.radius))
    share, frame = np.linspace(0, 1, SAMPLES), pose[side.index(tree)]
    radius, length = np.asarray(side.radius), np.asarray(side.length)
    along = share[None, :, None] * (length[:, None] * frame[:, :3, 0])[:, None]
    radii = radius[:, :1] + share * (radius[:, 1:] - radius[:, :1])
    return Balls((frame[:, None, :3, 3] + along).reshape(-1, 3), radii.ravel())


def _gaps(
    term: ContactTerm,
    first: Balls,
    tree: Tree,
    pose: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Distances between the surfaces [m], and the smaller radius there [m], both (balls, some)."""
    second = term.second
    if isinstance(second, Plane):
        frame = np.eye(4) if second.body is None else pose[second.index(tree)][0]
        normal = frame[:3, :3] @ (np.asarray(second.normal) / np.linalg.norm(second.normal))
        height = (first.centre - frame[:3, 3] - frame[:3, :3] @ np.asarray(second.point)) @ normal
        return (height - first.radius)[:, None], first.radius[:, None]
    if isinstance(second, Solids):
        frame, radius, length = pose[second.index(tree)], np.asarray(second.radius), np.asarray(second.length)
        local = np.einsum("sji,psj->psi", frame[:, :3, :3], first.centre[:, None] - frame[:, :3, 3])
        away, slope = np.hypot(local[..., 1], local[..., 2]), (radius[:, 0] - radius[:, 1]) / length
        place = np.clip(local[..., 0] - slope / np.sqrt(1 - slope**2) * away, 0, length)
        thick = radius[:, 0] - slope * place
        gap = np.hypot(local[..., 0] - place, away) - thick - first.radius[:, None]
        return gap, np.minimum(thick, first.radius[:, None])
    other = _balls(second, tree, pose)
    distance = np.linalg.norm(first.centre[:, None] - other.centre, axis=2)
    both = first.radius[:, None] + other.radius
    gap = distance - both
    if isinstance(term, TubeContact) and term.first.rod == term.second.rod:
        rod = tree[term.first.rod]
        assert isinstance(rod, Rod)
        along = float(rod.length) * rod.quadrature.points
        gap = np.where(np.abs(along[:, None] - along) > FAR * both, gap, np.inf)
    return gap, np.minimum(first.radius[:, None], other.radius)
