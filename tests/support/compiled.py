"""Functions of the package compiled at once: operation by operation they take seconds to compile."""

from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from exosight.arrays import AnyArray
from exosight.mechanics import Robot
from exosight.mechanics import walk as walk_plainly
from exosight.mechanics.surface_contact import SolidContact
from exosight.mechanics.surface_contact import contacts as contacts_plainly
from exosight.mechanics.tube_contact import TubeContact

walk = eqx.filter_jit(walk_plainly)
contacts = eqx.filter_jit(contacts_plainly)


@eqx.filter_jit
def touching(contact: SolidContact | TubeContact, robot: Robot, q: Float[AnyArray, " dofs"]) -> Any:
    """Where a contact's points are closest to what they may touch."""
    pose = walk_plainly(robot, q).pose
    return contact.closest(robot, pose) if isinstance(contact, TubeContact) else contact.contacts(robot, pose)


@eqx.filter_jit
def wrench(robot: Robot, q: Float[Array, " dofs"], loads: Float[Array, " loads"]) -> Float[Array, "frames 6"]:
    """Of a robot's first term on every frame."""
    return robot.terms[0].bind(robot)(q, walk_plainly(robot, q), loads).wrench
