"""What sensors read, and where surfaces are, at coordinates of a system."""

from collections.abc import Callable, Hashable, Iterable, Mapping
from functools import lru_cache, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight.arrays import AnyArray
from exosight.mechanics.contact import SphereContact
from exosight.mechanics.friction import Friction
from exosight.mechanics.kinematics import Motion, walk
from exosight.mechanics.rigid_contact import RigidContact
from exosight.mechanics.robot import Robot
from exosight.mechanics.rod import Rod
from exosight.mechanics.surface_contact import SolidContact
from exosight.mechanics.surfaces import Solids
from exosight.mechanics.term import Memories
from exosight.mechanics.tube_contact import TubeContact
from exosight.system.sensors import SensorInput, SurfaceForces, force_per_length
from exosight.system.surfaces import zone_middle
from exosight.system.system import System


class Observation(eqx.Module):
    """A system at one state; leading batch dimensions allowed.

    readings   (*batch, sensors)           in the order of the schema [each in its unit]
    forces     (*batch, zones, 3)          summed contact force on each zone, see `System.zones` [N]
    normals    (*batch, zones, 3)          the sum of the normal parts of the same; the rest is tangential [N]
    places     (*batch, zones, 3)          middle of each zone [m]
    axes       (*batch, nodes, 3) a tube   its axis, by the surface's name [m]
    """

    readings: Float[AnyArray, "*batch sensors"]
    forces: Float[AnyArray, "*batch zones 3"]
    normals: Float[AnyArray, "*batch zones 3"]
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
def body_axes(system: System, q: Float[AnyArray, "states dofs"]) -> dict[str, Float[Array, "states nodes 3"]]:
    """The axis of every tube of one system at each state, by its name [m]."""
    robot = system.robot

    def at(q: Float[Array, " dofs"]) -> dict[str, Float[Array, "nodes 3"]]:
        motion = walk(robot, q)
        return {tube.name: tube.axis(robot, motion) for tube in system.tubes}

    return jax.vmap(at)(jnp.asarray(q))


PROFILE_UNITS = {
    "place": "m, along the tube",
    "force": "x, y, z in N/m, at each place",
    "normal": "x, y, z in N/m, at each place: the part along the normals of the contacts",
}
"""What the arrays of `force_profiles` hold, by the beginning of their names."""


def force_profiles(
    system: System, q: Float[AnyArray, "states dofs"], history: Memories = (), places: int = 20
) -> dict[str, np.ndarray]:
    """Force per length along every tube that something presses on, at the middles of equal parts of it.

    history   of each state, see `Equilibria`
    returns   of each such tube place_NAME (states, places), distances along it [m], force_per_length_NAME and
              normal_per_length_NAME (states, places, 3), the whole and its normal part, in the world [N/m];
              see `exosight.system.sensors.force_per_length`
    """
    pressed = {name for contact in system.contacts for name in (contact.first, contact.second)}
    tubes = tuple(tube.name for tube in system.tubes if tube.name in pressed)
    found = _profiles(system, jnp.asarray(q), history, tubes, places)
    return {f"{what}_{name}": np.asarray(value) for name, of in found.items() for what, value in of.items()}


@eqx.filter_jit
def _profiles(
    system: System,
    states: Float[Array, "states dofs"],
    history: Memories,
    tubes: tuple[str, ...],
    places: int,
) -> dict[str, dict[str, Float[Array, "states ..."]]]:
    robot = system.robot
    lengths = {tube.name: tube.along(robot)[-1] for tube in system.tubes}

    def at(q: Float[Array, " dofs"], history: Memories) -> dict[str, dict[str, Float[Array, "..."]]]:
        on = contact_forces(system, system.robot_at(history), walk(robot, q))
        found = {}
        for name in tubes:
            forces, length = on[name], lengths[name]
            middles = (jnp.arange(places) + 0.5) * length / places
            whole, normal = (
                force_per_length(part, forces.place, middles, length)
                for part in (forces.force, forces.normal)
            )
            found[name] = {"place": middles, "force_per_length": whole, "normal_per_length": normal}
        return found

    return jax.vmap(at)(states, history)


def observe(
    systems: System, q: Float[AnyArray, "systems states dofs"], history: Memories = ()
) -> Observation:
    """Sensors and surfaces of stacked systems at coordinates q, see `stack_systems`.

    history   of each state, see `Equilibria`; only systems with friction or in time have one
    returns   with batch dimensions (systems, states)

    Raises InputError for a history that is not the systems'.
    """
    return observing(systems)(q, history)


def observing(systems: System) -> Callable[..., Observation]:
    """`observe` of these systems, to be called with (q, history) many times: they are taken apart once."""
    numbers, structure = jax.tree.flatten(systems)
    return partial(_observed(structure), jax.device_put(numbers))


@lru_cache(maxsize=64)
def _observed(structure: Hashable) -> Callable[..., Observation]:
    """Compiled for systems of one structure."""

    @jax.jit
    def observed(
        numbers: list[Array], q: Float[Array, "systems states dofs"], history: Memories = ()
    ) -> Observation:
        def of_states(system: System, q: Array, history: Memories) -> Observation:
            return jax.vmap(partial(observe_state, system))(q, history)

        return jax.vmap(of_states)(jax.tree.unflatten(structure, numbers), q, history)

    return observed


def observe_state(system: System, q: Float[Array, " dofs"], history: Memories = ()) -> Observation:
    """The same of one system at one state; JAX can differentiate it."""
    robot = system.robot_at(history)
    motion = walk(robot, q)
    surfaces = {surface.name: surface for surface in system.surfaces}
    at = SensorInput(robot, q, contact_forces(system, robot, motion), {})
    values: dict[str, Array] = {}
    for sensor in system.sensors:
        values[sensor.spec.name] = sensor.read(at._replace(values=values))
    zones = system.zones

    def stacked(vectors: Iterable[Float[Array, "3"]]) -> Float[Array, "zones 3"]:
        return jnp.stack([*vectors]) if zones else jnp.zeros((0, 3))

    return Observation(
        readings=jnp.stack(list(values.values())),
        forces=stacked(zone.vector(at, "magnitude") for zone in zones),
        normals=stacked(zone.vector(at, "normal") for zone in zones),
        places=stacked(zone_middle(zone, surfaces[zone.surface], robot, motion) for zone in zones),
        axes={tube.name: tube.axis(robot, motion) for tube in system.tubes},
    )


def contact_forces(system: System, robot: Robot, motion: Motion) -> dict[str, SurfaceForces]:
    """What presses on each surface, by its name; the robot with the memories of the state."""
    frictions = iter([term for term in robot.terms if isinstance(term, Friction)])
    parts: dict[str, list[SurfaceForces]] = {surface.name: [] for surface in system.surfaces}
    for contact, term in zip(system.contacts, system.contact_terms, strict=True):
        match term:
            case SphereContact():
                sides = _on_spheres(term, robot, motion)
            case SolidContact():
                sides = _on_solids(term, robot, motion)
            case TubeContact():
                sides = _on_tubes(term, robot, motion)
            case RigidContact():
                sides = _on_links(term, robot, motion)
        for name, side in zip((contact.first, contact.second), sides, strict=True):
            parts[name].append(side)
        if contact.friction is not None:
            for name, side in zip(
                (contact.first, contact.second), _friction(next(frictions), robot, motion, sides), strict=True
            ):
                parts[name].append(side)
    none = SurfaceForces(jnp.zeros((0, 3)), jnp.zeros((0, 3)), jnp.zeros(0))
    return {
        name: jax.tree.map(lambda *values: jnp.concatenate(values), none, *found)
        for name, found in parts.items()
    }


def _on_spheres(term: SphereContact, robot: Robot, motion: Motion) -> tuple[SurfaceForces, SurfaceForces]:
    first, second = (
        SurfaceForces(force, force, jnp.arange(float(len(force))))
        for force in term.forces(robot, motion.position)
    )
    return first, second


def _on_solids(term: SolidContact, robot: Robot, motion: Motion) -> tuple[SurfaceForces, SurfaceForces]:
    """Every sample with each of the two solids that it may touch; distances along the chain of solids."""
    at = term.contacts(robot, motion.pose)
    push = term.pressure(robot, at)
    force = jnp.concatenate(
        [(share * push)[:, None] * touch.normal for share, touch in zip(at.share, at.touches, strict=True)]
    )
    place = jnp.concatenate([touch.which @ term.second.starts + touch.place for touch in at.touches])
    along = term.samples(robot).lumping.T @ _along(term.first.rod, robot)
    first = SurfaceForces(force, force, jnp.concatenate([along, along]))
    return first, SurfaceForces(-force, -force, place)


def _on_tubes(term: TubeContact, robot: Robot, motion: Motion) -> tuple[SurfaceForces, SurfaceForces]:
    force, at = term.forces(robot, motion.pose)
    nodes = _along(term.second.rod, robot)
    place = nodes[at.piece] + at.t * (nodes[at.piece + 1] - nodes[at.piece])
    first = SurfaceForces(force, force, term.samples(robot).lumping.T @ _along(term.first.rod, robot))
    return first, SurfaceForces(-force, -force, place)


def _on_links(term: RigidContact, robot: Robot, motion: Motion) -> tuple[SurfaceForces, SurfaceForces]:
    """Every pair; distances along the chains of solids."""
    force, at = term.forces(robot, motion.pose)
    first, second = (
        (side.starts if isinstance(side, Solids) else jnp.zeros(1))[at.solid[:, i]] + at.place[:, i]
        for i, side in enumerate((term.first, term.second))
    )
    return SurfaceForces(force, force, first), SurfaceForces(-force, -force, second)


def _friction(
    term: Friction, robot: Robot, motion: Motion, sides: tuple[SurfaceForces, SurfaceForces]
) -> tuple[SurfaceForces, SurfaceForces]:
    """Tangential forces, where the normal ones act: of each point on what it touches most."""
    force = term.forces(robot, motion)
    if isinstance(term.contact, SolidContact | TubeContact):
        push = term.contact.pushes(robot, motion.pose)
        force = term.contact.samples(robot).spread(push, force)
    places = [side.place[: len(force)] for side in sides]
    if isinstance(term.contact, SphereContact):  # whose sides hold the sums over all pairs of a sphere
        counts = [len(side.place) for side in sides]
        places = [jnp.repeat(sides[0].place, counts[1]), jnp.tile(sides[1].place, counts[0])]
    none = jnp.zeros_like(force)
    return SurfaceForces(force, none, places[0]), SurfaceForces(-force, none, places[1])


def _along(rod: str, robot: Robot) -> Float[Array, " points"]:
    """Distance of a rod's points from its base, unbent [m]."""
    body = robot[rod]
    assert isinstance(body, Rod)
    return jnp.asarray(body.length * body.quadrature.points)
