"""What sensors read, and where surfaces are, at coordinates of a system."""

from collections.abc import Mapping
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight.arrays import AnyArray
from exosight.mechanics.kinematics import walk
from exosight.mechanics.robot import Robot
from exosight.system.sensors import ContactForce, SensorInput
from exosight.system.surfaces import SphereSurface
from exosight.system.system import System


class Observation(eqx.Module):
    """A system at one state; leading batch dimensions allowed.

    readings   (*batch, sensors)           in the order of the schema [each in its unit]
    forces     (*batch, zones, 3)          summed contact force on each zone, in the order of the sensors [N]
    places     (*batch, zones, 3)          middle of each zone [m]
    axes       (*batch, nodes, 3) a tube   its axis, by the surface's name [m]
    """

    readings: Float[AnyArray, "*batch sensors"]
    forces: Float[AnyArray, "*batch zones 3"]
    places: Float[AnyArray, "*batch zones 3"]
    axes: dict[str, Float[AnyArray, "*batch nodes 3"]]


POSE_UNITS = {"axis": "x, y, z in m, of each node on the centreline", "radius": "m, at each node"}
"""What the arrays of `body_shapes` hold, by the beginning of their names."""


def body_shapes(
    system: System, axes: Mapping[str, Float[AnyArray, "states nodes 3"]]
) -> dict[str, np.ndarray]:
    """The centrelines of a system's bodies and the radii along them, as other programs take them.

    axes      of every tube in each state [m], see `Observation`
    returns   of each tube axis_NAME (states, nodes, 3) and radius_NAME (states, nodes) [m]
    """
    found: dict[str, np.ndarray] = {}
    for tube in system.tubes:
        axis = np.asarray(axes[tube.name], np.float64)
        found[f"axis_{tube.name}"] = axis
        found[f"radius_{tube.name}"] = np.tile(np.asarray(tube.radius, np.float64), (len(axis), 1))
    return found


@eqx.filter_jit
def observe(systems: System, q: Float[AnyArray, "systems states dofs"]) -> Observation:
    """Sensors and surfaces of stacked systems at coordinates q, see `stack_systems`.

    returns   with batch dimensions (systems, states)
    """
    return jax.vmap(lambda system, path: jax.vmap(partial(observe_state, system))(path))(
        systems, jnp.asarray(q)
    )


def observe_state(system: System, q: Float[Array, " dofs"]) -> Observation:
    """The same of one system at one state; JAX can differentiate it."""
    robot = system.robot
    motion = walk(robot, q)
    position = motion.position
    forces = _sphere_forces(system, robot, position)
    at = SensorInput(robot, q, forces, {})
    values: dict[str, Array] = {}
    for sensor in system.sensors:
        values[sensor.spec.name] = sensor.read(at._replace(values=values))
    zones = [sensor for sensor in system.sensors if isinstance(sensor, ContactForce)]
    centres = {
        surface.name: position[np.array(surface.spheres.index(robot))]
        for surface in system.surfaces
        if isinstance(surface, SphereSurface)
    }
    none = jnp.zeros((0, 3))
    return Observation(
        readings=jnp.stack(list(values.values())),
        forces=jnp.stack([zone.vector(at) for zone in zones]) if zones else none,
        places=jnp.stack([centres[z.surface][np.array(z.spheres)].mean(axis=0) for z in zones])
        if zones
        else none,
        axes={tube.name: tube.axis(robot, motion) for tube in system.tubes},
    )


def _sphere_forces(
    system: System, robot: Robot, position: Float[Array, "frames 3"]
) -> dict[str, Float[Array, "spheres 3"]]:
    """The contact force on every sphere of every surface [N]."""
    forces: dict[str, Array] = {
        surface.name: jnp.zeros((len(surface.spheres.frames), 3))
        for surface in system.surfaces
        if isinstance(surface, SphereSurface)
    }
    for contact, term in zip(system.contacts, system.contact_terms, strict=True):
        on_first, on_second = term.forces(robot, position)
        forces[contact.first] = forces[contact.first] + on_first
        forces[contact.second] = forces[contact.second] + on_second
    return forces
