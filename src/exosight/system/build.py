"""From a description to a system: bodies in order, spheres and tubes on them, actuators, sensors, cameras."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from exosight import lie
from exosight.arrays import floats
from exosight.errors import InputError
from exosight.mechanics import (
    Circular,
    Fixed,
    Gauss,
    Gravity,
    JointTorque,
    Link,
    NodalQuadratic,
    PressureLine,
    Revolute,
    Rod,
    Universal,
)
from exosight.mechanics.contact import Spheres
from exosight.mechanics.joint import Joint
from exosight.mechanics.term import Term
from exosight.mechanics.tree import Body
from exosight.system.camera import Camera
from exosight.system.description import (
    ActuatorTable,
    Description,
    JointTable,
    LinkTable,
    RadiusProfile,
    RodTable,
    SensorTable,
    SurfaceTable,
)
from exosight.system.profile import Profile, from_formula, from_points
from exosight.system.schema import Channel, SensorSpec
from exosight.system.sensors import ContactForce, JointAngle, NetForce, Sensor
from exosight.system.surfaces import Node, SphereSurface, Surface, TubeSurface
from exosight.system.system import Actuator, Contact, System
from exosight.system.units import FORCE, LENGTH, split_quantity

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def build(description: Description) -> System:
    """The system that a description describes.

    Raises InputError, beginning with the place in the file, for entries that contradict each other.
    """
    bodies = tuple(_body(description, name) for name in _order(description))
    names = [body.name for body in bodies]
    surfaces: list[Surface] = []
    for name, table in description.surfaces.items():
        for i, body in enumerate(table.bodies):
            if body not in names:
                raise InputError(
                    f"surfaces.{name}.bodies.{i}: there is no body {body!r}; there are {', '.join(names)}"
                )
        kind = _tube if table.type == "tube" else _spheres
        surfaces.append(kind(description, name, table))
    contacts = tuple(
        Contact(name, table.first, table.second, floats(table.stiffness))
        for name, table in description.contacts.items()
    )
    rods = {body.name: body for body in bodies if isinstance(body, Rod)}
    actuators = tuple(
        _at(f"actuators.{name}", lambda: _actuator(description, rods, name, table, place))
        for place, (name, table) in enumerate(description.actuators.items())
    )
    cameras = tuple(
        (name, Camera(table.centre, table.pixel, table.width, table.height))
        for name, table in description.cameras.items()
    )
    sensors = tuple(_sensor(description, name, table) for name, table in description.sensors.items())
    weight = (Gravity(jnp.array(description.gravity)),) if any(description.gravity) else ()
    system = System(
        description.name, bodies, tuple(surfaces), contacts, actuators, sensors, cameras, energies=weight
    )
    _at("sensors", lambda: system.schema)
    if not system.tubes:
        raise InputError("surfaces: expected at least one of type tube, for the cameras, got none")
    if not system.schema.estimated:
        raise InputError("sensors: expected at least one with estimated = true, for networks, got none")
    return system


def _at(place: str, make: Callable) -> object:
    """What `make` returns; what it raises names the place in the file."""
    try:
        return make()
    except ValueError as error:  # InputError and pydantic's ValidationError are such
        text = str(error).splitlines()
        message = next((line.strip() for line in text if "Value error, " in line), text[0])
        message = message.removeprefix("Value error, ").split(" [type=")[0]
        raise InputError(message if message.startswith(place) else f"{place}: {message}") from None


def _order(description: Description) -> list[str]:
    """Names of the bodies, parents before children, otherwise as in the file: rods first."""
    parents = {name: table.parent for name, table in [*description.rods.items(), *description.links.items()]}
    kinds = {**dict.fromkeys(description.rods, "rods"), **dict.fromkeys(description.links, "links")}
    order: list[str] = []
    for start in parents:
        chain: list[str] = []
        name: str | None = start
        while name is not None and name not in order:
            if name not in parents:
                place = f"{kinds[chain[-1]]}.{chain[-1]}.parent"
                raise InputError(f"{place}: there is no body {name!r}; there are {', '.join(parents)}")
            if name in chain:
                place = f"{kinds[start]}.{start}.parent"
                raise InputError(
                    f"{place}: {' sits on '.join([*chain[chain.index(name) :], name])}, a cycle; one body must "
                    "sit on the ground"
                )
            chain.append(name)
            name = parents[name]
        order += reversed(chain)
    return order


def _body(description: Description, name: str) -> Body:
    if name in description.rods:
        return _at(f"rods.{name}", lambda: _rod(name, description.rods[name]))  # type: ignore[return-value]
    return _at(f"links.{name}", lambda: _link(description, name))  # type: ignore[return-value]


def _rod(name: str, table: RodTable) -> Rod:
    points = Gauss(table.elements, table.points_per_element)
    return Rod(
        name,
        table.length,
        Circular(_radii(name, table, points.points)),
        young=table.young,
        poisson=table.poisson,
        density=table.density,
        strains={strain: NodalQuadratic(table.elements) for strain in table.strains},
        quadrature=points,
        parent=table.parent,
        mount=_mount(table),
    )


def _link(description: Description, name: str) -> Link:
    """A link with a site at its base, then at every place where a surface has a sphere, then at its middle."""
    table = description.links[name]
    places = _places(description, name)
    sites = np.array([[place * table.length, 0.0, 0.0] for place in places])
    mass = np.zeros(len(places))
    mass[-1] = table.mass
    return Link(
        name,
        table.length,
        sites,
        parent=table.parent,
        joint=_joint(table.joint),
        mount=_mount(table),
        mass=mass,
    )


def _places(description: Description, link: str) -> list[float]:
    """Where along a link its sites are, as shares of its length: base, spheres, middle."""
    spheres = {
        place
        for surface in description.surfaces.values()
        if link in surface.bodies
        for place in surface.at or ()
    }
    return [0.0, *sorted(spheres - {0.0}), 0.5]


def _joint(table: JointTable) -> Joint:
    if table.type == "fixed":
        return Fixed()
    springs: dict = {"stiffness": table.stiffness}
    if table.range is not None:
        springs |= {"limits": table.range, "limit_stiffness": table.limit_stiffness}
    return Universal(**springs) if table.type == "universal" else Revolute(_AXES[table.axis], **springs)


def _mount(table: LinkTable | RodTable) -> Float[np.ndarray, "4 4"]:
    mount = np.array(lie.exp(jnp.array([*table.rotation, 0.0, 0.0, 0.0])))
    mount[:3, 3] = table.position
    return mount


def profile_of(table: RodTable) -> Profile:
    """The radius of a rod along its length [m], and its slope; ValueError for a formula that is none."""
    radius = table.radius
    if not isinstance(radius, RadiusProfile):
        return Profile(lambda x: np.full(len(x), float(radius)), lambda x: np.zeros(len(x)))
    unit = LENGTH.units[radius.unit] * radius.scale
    if radius.formula is not None:
        return from_formula(radius.formula, unit)
    assert radius.values is not None  # a file's CSV has become values when it was read
    values = np.array(radius.values)
    x = np.linspace(0, 1, len(values)) if radius.x is None else np.array(radius.x)
    return from_points(x, unit * values)


def _radii(name: str, table: RodTable, x: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
    try:
        radii = profile_of(table).value(x)
    except ValueError as error:
        raise InputError(f"rods.{name}.radius: {error}") from None
    if not np.all(np.isfinite(radii) & (radii > 1e-6) & (radii < 10)):
        raise InputError(
            f"rods.{name}.radius: expected radii above 1e-6 m all along the rod, got {np.min(radii):g} m at "
            f"X = {x[np.argmin(radii)]:.2f}"
        )
    return radii


def _tube(description: Description, name: str, table: SurfaceTable) -> TubeSurface:
    """A rod's points, or the bases of links in a chain and the end of the last one."""
    if table.at is not None:
        raise InputError(f"surfaces.{name}.at: a tube runs along its bodies; leave it out")
    first = table.bodies[0]
    if first in description.rods:
        if len(table.bodies) > 1:
            raise InputError(
                f"surfaces.{name}.bodies: expected one rod, or links in a chain, got a rod and more"
            )
        rod = description.rods[first]
        points = Gauss(rod.elements, rod.points_per_element)
        nodes: tuple[Node, ...] = tuple((first, i) for i in range(points.size))
        return TubeSurface(name, nodes, floats(_radii(first, rod, points.points)), table.shade)
    for before, after in zip(table.bodies, table.bodies[1:], strict=False):
        if after not in description.links or description.links[after].parent != before:
            raise InputError(
                f"surfaces.{name}.bodies: expected links in a chain, but {after} does not sit on {before}"
            )
    links = [description.links[body] for body in table.bodies]
    radii = np.array([*(link.radius[0] for link in links), links[-1].radius[1]])
    return TubeSurface(
        name, (*((body, 0) for body in table.bodies), (table.bodies[-1], "end")), radii, table.shade
    )


def _spheres(description: Description, name: str, table: SurfaceTable) -> SphereSurface:
    """A sphere at each point of a rod, or at the given places along each link, as thick as the body there."""
    frames: list[tuple[str, int]] = []
    radii: list[float] = []
    for body in table.bodies:
        if body in description.rods:
            rod = description.rods[body]
            points = Gauss(rod.elements, rod.points_per_element)
            frames += [(body, i) for i in range(points.size)]
            radii += _radii(body, rod, points.points).tolist()
            continue
        if table.at is None:
            raise InputError(f"surfaces.{name}.at: expected places along {body} from 0 to 1, got none")
        link, places = description.links[body], _places(description, body)
        base, end = link.radius
        frames += [(body, places.index(place)) for place in table.at]
        radii += [base + (end - base) * place for place in table.at]
    return SphereSurface(name, Spheres(tuple(frames), floats(radii)))


def _actuator(
    description: Description, rods: dict[str, Rod], name: str, table: ActuatorTable, place: int
) -> Actuator:
    (low, unit), (high, other) = (split_quantity(text, "4 N") for text in table.range)
    if unit != other:
        raise InputError(f"range: expected both ends in one unit, got {unit} and {other}")
    natural = "N m" if table.type == "joint_torque" else "N"
    gain, unit, scale = _gain(table, unit, natural)
    command_unit = split_quantity(table.range[0], "4 N")[1]
    rate = _command(table.rate, f"{command_unit}/s", "rate")
    drive = _command(table.drive, command_unit, "drive")
    channel = Channel(
        name,
        unit,
        low * scale,
        high * scale,
        None if rate is None else rate * scale,
        None if drive is None else drive * scale,
    )
    return Actuator(channel, _actuating_term(description, rods, table, place), floats(gain))


def _command(text: str | None, unit: str, entry: str) -> float | None:
    """The number of a command or its rate, in the unit of the range."""
    if text is None:
        return None
    value, found = split_quantity(text, f"10 {unit}")
    if found.replace(" ", "") != unit.replace(" ", ""):
        raise InputError(f"{entry}: expected it in {unit}, as the range is, got {text!r}")
    return value


def _gain(table: ActuatorTable, unit: str, natural: str) -> tuple[float, str, float]:
    """Load per unit of command, the channel's unit, and the factor from the file's unit to that."""
    sign = -1.0 if table.type == "cable" else 1.0
    forces = FORCE.units if natural == "N" else {"N m": 1.0, "mN m": 1e-3, "N mm": 1e-3}
    if unit in forces:
        if table.gain is not None:
            raise InputError(f"gain: a command in {unit} needs none; leave it out")
        return sign, natural, forces[unit]
    if table.gain is None:
        raise InputError(
            f'gain: expected what a command in {unit} does, like "0.05 {natural}/{unit}", got none'
        )
    value, per = split_quantity(table.gain, f"0.05 {natural}/{unit}")
    if per.replace(" ", "") != f"{natural}/{unit}".replace(" ", ""):
        raise InputError(f"gain: expected it in {natural}/{unit}, got {table.gain!r}")
    if value == 0:
        raise InputError("gain: expected another number than 0")
    return sign * value, unit, 1.0


def _actuating_term(description: Description, rods: dict[str, Rod], table: ActuatorTable, place: int) -> Term:
    if table.type == "joint_torque":
        link = description.links.get(table.body)
        dofs = {"fixed": 0, "revolute": 1, "universal": 2}[link.joint.type] if link else 0
        if table.coordinate >= dofs:
            raise InputError(
                f"body: expected a link with a joint of more than {table.coordinate} coordinates"
            )
        return JointTorque(table.body, place, table.coordinate)
    if table.body not in rods:
        raise InputError(f"body: there is no rod {table.body!r}; there are {', '.join(rods) or 'none'}")
    rod = rods[table.body]
    x = rod.quadrature.points
    if table.offset is None:
        profile = profile_of(description.rods[table.body])
        radius, slope = profile.value(x), profile.slope(x)
    else:
        radius, slope = np.full(len(x), table.offset), np.zeros(len(x))
    turn = 2 * np.pi * table.turns
    angle = turn * x + table.angle
    across = np.stack([np.zeros(len(x)), np.cos(angle), np.sin(angle)], axis=1)
    ahead = np.stack([np.zeros(len(x)), -np.sin(angle), np.cos(angle)], axis=1)
    length = description.rods[table.body].length
    return PressureLine(
        rod=table.body,
        channel=place,
        offset=radius[:, None] * across,
        slope=(slope[:, None] * across + (turn * radius)[:, None] * ahead) / length,
    )


def _sensor(description: Description, name: str, table: SensorTable) -> Sensor:
    place = f"sensors.{name}"
    if table.type == "joint_angle":
        link = description.links.get(table.body or "")
        dofs = {"fixed": 0, "revolute": 1, "universal": 2}[link.joint.type] if link else 0
        if table.coordinate >= dofs:
            raise InputError(
                f"{place}.body: expected a link with a joint of more than {table.coordinate} coordinates, got "
                f"{table.body!r}"
            )
        spec = SensorSpec(name, "joint angle", "rad", estimated=table.estimated)
        return JointAngle(spec, table.body or "", table.coordinate)
    if table.type == "net_force":
        return NetForce(SensorSpec(name, "net force", "N", parts=table.parts or (), limit=table.limit))
    surface = description.surfaces.get(table.surface or "")
    if surface is None or surface.type != "spheres":
        known = [each for each, s in description.surfaces.items() if s.type == "spheres"]
        raise InputError(
            f"{place}.surface: there is no surface of spheres {table.surface!r}; there are {', '.join(known) or 'none'}"
        )
    frames = _spheres(description, table.surface or "", surface).spheres.frames
    chosen = table.spheres
    if chosen is None:
        chosen = tuple(i for i, (body, _) in enumerate(frames) if body == table.body)
        if not chosen:
            raise InputError(f"{place}.body: {table.surface} has no sphere on {table.body!r}")
    if max(chosen) >= len(frames) or len(set(chosen)) < len(chosen):
        raise InputError(
            f"{place}.spheres: expected different numbers from 0 to {len(frames) - 1}, the spheres of "
            f"{table.surface}, got {list(chosen)}"
        )
    spec = SensorSpec(name, "contact force", "N", estimated=table.estimated, limit=table.limit)
    return ContactForce(spec, table.surface or "", chosen)
