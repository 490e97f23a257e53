"""Coulomb friction of contacts, with stick and slip, and memory of where each point last stuck.

Each point of a contact that is pressed with a force N holds on to the place it touched, by a tangential
spring of stiffness k: the silicone and the skin around it shear. With the displacement v of the point along
the surface since it was free of force, the friction force is

    f = k v               while k |v| ≤ μ N (stick)
    f = μ N v/|v|         beyond (slip)

which is the gradient of Huber's function of v for the present normal force N: the dissipation potential of
an implicit step. At the end of the step the place moves on, so that the spring holds f. Rolling carries the
place along. Friction has no potential in N: ∂f/∂N stands in `Expansion.coupling`.

v is that of a material point of the first body in a frame of the second one, projected on the tangent plane
of the beginning of the step. Source of the return to μ N: Wriggers, Computational Contact Mechanics (2006),
section 5.2.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight import lie
from exosight.arrays import AnyArray, Number, floats, known
from exosight.errors import InputError
from exosight.mechanics.contact import SphereContact
from exosight.mechanics.kinematics import Motion, at_points
from exosight.mechanics.rigid_contact import RigidContact
from exosight.mechanics.surface_contact import SolidContact
from exosight.mechanics.term import (
    Bound,
    Expansion,
    TermWithMemory,
    point_stiffness,
    point_wrench,
    square,
    sum_on_frames,
    where_each,
    zero,
)
from exosight.mechanics.tree import Tree
from exosight.mechanics.tube_contact import TubeContact

SHEAR = 2 / 3
"""Tangential stiffness of a contact relative to its normal one: 2 (1 − ν)/(2 − ν) of two spheres, for ν = ½.
Source: K. L. Johnson, Contact Mechanics (1985), section 7.3, after Mindlin."""

SIZE = 12
"""Numbers that are remembered of each point."""


WithPoints = SphereContact | SolidContact | TubeContact | RigidContact
"""Contacts that tell what each of their points presses on (`Pressing`)."""


class Held(NamedTuple):
    """What friction remembers of each point of a contact.

    lever        (points, 3)   the material point, in its own frame [m]
    anchor       (points, 3)   where it would be free of force, in the partner's frame [m]
    normal       (points, 3)   unit vector, in the partner's frame
    bound        (points,)     μ N [N]
    partner      (points,)     number of the second side's frame that it touches; −1: not known yet
    dissipated   (points,)     work lost to friction so far [J]
    """

    lever: Float[AnyArray, "points 3"]
    anchor: Float[AnyArray, "points 3"]
    normal: Float[AnyArray, "points 3"]
    bound: Float[AnyArray, " points"]
    partner: Float[AnyArray, " points"]
    dissipated: Float[AnyArray, " points"]

    @staticmethod
    def of(memory: Float[AnyArray, f"points {SIZE}"]) -> "Held":
        """From the columns of an array."""
        return Held(*(memory[:, 3 * i : 3 * i + 3] for i in range(3)), *(memory[:, i] for i in (9, 10, 11)))

    def array(self) -> Float[Array, f"points {SIZE}"]:
        """As the columns of an array."""
        scalars = jnp.stack([self.bound, self.partner, self.dissipated], axis=1)
        return jnp.concatenate([self.lever, self.anchor, self.normal, scalars], axis=1)


class Slip(NamedTuple):
    """The friction of each point at one pose.

    place        (points, 3)   of the material point, in the world [m]
    stretch      (points, 3)   v, in the world [m]
    length       (points,)     |v| [m]
    held         (points,)     the part of v that the spring holds, 1 where it sticks
    """

    place: Float[Array, "points 3"]
    stretch: Float[Array, "points 3"]
    length: Float[Array, " points"]
    held: Float[Array, " points"]


class Friction(TermWithMemory):
    """Friction of a contact.

    contact       whose normal forces it follows
    coefficient   ()            μ
    memory        (points, 12)  see `Held`

    Raises InputError for a coefficient below 0.
    """

    contact: WithPoints
    coefficient: Float[AnyArray, ""]

    def slip(self, tree: Tree, motion: Motion, push: Float[AnyArray, " points"]) -> Slip:
        """How far each point has been displaced since it was free of force."""
        held = Held.of(self.memory)
        own = motion.pose[self.contact.point_frames(tree)]
        other = self._partner(tree, motion.pose, held.partner, jnp.eye(4))
        place = own[:, :3, 3] + _turned(own, held.lever)
        away = _turned_back(other, place - other[:, :3, 3]) - held.anchor
        along = away - jnp.sum(away * held.normal, axis=1, keepdims=True) * held.normal
        along = jnp.where((held.partner >= 0)[:, None], along, 0.0)
        length = jnp.sqrt(jnp.sum(along**2, axis=1) + 1e-40)
        whole, most = self.stiffness(tree) * length, self.coefficient * push
        # A point that slipped at the end of the last step is taken to go on.
        slips = whole >= (1 - 1e-9) * most
        held = jnp.where(slips, jnp.minimum(1 - 1e-15, most / jnp.where(whole > 0, whole, 1.0)), 1.0)
        return Slip(place, _turned(other, along), length, held)

    def stiffness(self, tree: Tree) -> Float[AnyArray, " points"]:
        """k of each point [N/m]."""
        return SHEAR * self.contact.point_stiffness(tree)

    def forces(self, tree: Tree, motion: Motion) -> Float[AnyArray, "points 3"]:
        """The friction force on each point of the contact's first side, in the world [N]."""
        slip = self.slip(tree, motion, self.contact.pressing(tree, motion).force)
        return -(self.stiffness(tree) * slip.held)[:, None] * slip.stretch

    def remember(
        self, tree: Tree, motion: Motion, loads: Float[Array, " loads"]
    ) -> Float[Array, f"points {SIZE}"]:
        """The place that each point touches now, with the force that it is held by."""
        held, now = Held.of(self.memory), self.contact.pressing(tree, motion)
        own = motion.pose[self.contact.point_frames(tree)]
        other = self._partner(tree, motion.pose, now.partner, jnp.eye(4))
        slip, k = self.slip(tree, motion, now.force), self.stiffness(tree)
        whole = slip.held[:, None] * slip.stretch
        # Turned with the surface, as long as before: what slipped is at the limit still.
        flat = whole - jnp.sum(whole * now.normal, axis=1, keepdims=True) * now.normal
        length, left = (jnp.sqrt(jnp.sum(v**2, axis=1) + 1e-40) for v in (whole, flat))
        across = left < 1e-6 * length  # the surface's new normal
        kept = flat * jnp.where(across, 0.0, length / left)[:, None]
        bound = self.coefficient * now.force
        slid = slip.length * (1 - slip.held)
        lost = jnp.where(across, 0.5 * k * length**2, 0.0)
        return Held(
            lever=_turned_back(own, now.place - own[:, :3, 3]),
            anchor=_turned_back(other, now.place - kept - other[:, :3, 3]),
            normal=_turned_back(other, now.normal),
            bound=bound,
            partner=now.partner,
            dissipated=held.dissipated + 0.5 * (held.bound + bound) * slid + lost,
        ).array()

    def dissipated(self) -> Float[Array, ""]:
        """Of all points."""
        return jnp.sum(jnp.asarray(Held.of(self.memory).dissipated))

    def discrepancy(
        self, tree: Tree, motion: Motion, v: Float[Array, " dofs"], loads: Float[Array, " loads"]
    ) -> Float[Array, ""]:
        """The speed at which points slip back that have slipped one way in the step as a whole."""
        now, twist = self.contact.pressing(tree, motion), motion.twist(v)
        slip, own = self.slip(tree, motion, now.force), twist[self.contact.point_frames(tree)]
        relative = own - self._partner(tree, twist, Held.of(self.memory).partner, jnp.zeros(6))
        moved = relative[:, 3:] + jnp.cross(relative[:, :3], slip.place)
        stretching = self.coefficient * (now.rate @ v) / self.stiffness(tree)
        back = stretching - jnp.sum(moved * slip.stretch, axis=1) / slip.length
        return jnp.max(jnp.where((slip.held < 1) & (now.force > 0), back, 0.0), initial=0.0)

    def bind(self, tree: Tree) -> Bound:
        """As in contact with solids, the energy of a step depends on each point's motion against its partner.

        `energy` is what the springs hold.
        """
        a, b = self.contact.point_frames(tree), self.contact.partner_frames(tree)
        k = self.stiffness(tree)

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            now, held = self.contact.pressing(tree, motion), Held.of(self.memory)
            slip = self.slip(tree, motion, now.force)
            pull = jnp.where(held.partner >= 0, k * slip.held, 0.0)
            force = pull[:, None] * slip.stretch
            normal = _turned(self._partner(tree, motion.pose, held.partner, jnp.eye(4)), held.normal)
            direction = slip.stretch / slip.length[:, None]
            # Stuck, the spring's; slipping, a force of given size only turns.
            slips = jnp.where(slip.held < 1, 1.0, 0.0)
            bend = jnp.eye(3) - square(normal) - slips[:, None, None] * square(direction)
            own = point_stiffness(slip.place, force, pull[:, None, None] * bend)
            wrench = point_wrench(slip.place, force)
            pressed = now.force > 0
            chosen = jnp.where((held.partner[:, None] == np.arange(len(b))) & pressed[:, None], 1.0, 0.0)
            jacobian_a = motion.jacobian[a]
            still = jnp.zeros(jacobian_a.shape[1:])
            jacobian_b = self._partner(tree, motion.jacobian, held.partner, still)
            coupled = (own + 0.5 * lie.coad(wrench)) @ jacobian_b
            block = -jnp.einsum("pia,pib->ab", jacobian_a, where_each(pressed, coupled))
            relative = at_points(jacobian_a, slip.place) - at_points(jacobian_b, slip.place)
            slide = jnp.einsum("pi,pia->pa", slips[:, None] * self.coefficient * direction, relative)
            slide = where_each(pressed, slide)
            on_b = jnp.einsum("pn,pij->nij", chosen, own)
            on_a = where_each(pressed, wrench), where_each(pressed, own)
            return zero(tree, loads)._replace(
                energy=0.5 * jnp.sum(k * (slip.held * slip.length) ** 2),
                wrench=sum_on_frames(on_a[0], a, tree.frames)
                - sum_on_frames(chosen.T @ wrench, b, tree.frames),
                stiffness=sum_on_frames(on_a[1], a, tree.frames) + sum_on_frames(on_b, b, tree.frames),
                hessian=block + block.T,
                coupling=slide.T @ now.rate,
            )

        return expand

    def _partner(
        self,
        tree: Tree,
        values: Float[Array, "frames ..."],
        partner: Float[AnyArray, " points"],
        of_world: Float[Array, "..."],
    ) -> Float[Array, "points ..."]:
        """A value of each point's partner, which is the world where the second side has no frames."""
        table = jnp.concatenate([values[self.contact.partner_frames(tree)], of_world[None]])
        return table.at[jnp.maximum(partner, 0.0).astype(int)].get(mode="promise_in_bounds")


def friction(contact: WithPoints, coefficient: Number, tree: Tree) -> Friction:
    """Friction with nothing to remember yet.

    coefficient   μ [-]

    Raises InputError for a coefficient that is negative or not finite.
    """
    if known(coefficient) and not 0 <= coefficient < np.inf:
        raise InputError(f"friction coefficient: expected a finite number of at least 0, got {coefficient}")
    memory = np.zeros((len(contact.point_frames(tree)), SIZE))
    memory[:, -2] = -1.0
    return Friction(memory, contact, floats(coefficient))


def _turned(
    pose: Float[Array, "points 4 4"], vector: Float[AnyArray, "points 3"]
) -> Float[Array, "points 3"]:
    return jnp.einsum("pij,pj->pi", pose[:, :3, :3], vector)


def _turned_back(
    pose: Float[Array, "points 4 4"], vector: Float[AnyArray, "points 3"]
) -> Float[Array, "points 3"]:
    return jnp.einsum("pji,pj->pi", pose[:, :3, :3], vector)
