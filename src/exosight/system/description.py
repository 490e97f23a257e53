"""A system in a user's words: what a system file may say, table by table.

Quantities are texts with their unit ("45 mm", "300 kPa"); everything else is a number, a name or a list. This
is the one place that says which entries there are, their defaults and their limits; `build` makes the system.
Usable without JAX.
"""

from collections.abc import Collection, Mapping
from dataclasses import fields
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag
from pydantic.dataclasses import dataclass

from exosight.system.camera import LARGEST_SIDE, Offset, Visibility
from exosight.system.schema import Component
from exosight.system.units import (
    Acceleration,
    Angle,
    Aside,
    ContactDamping,
    Density,
    Distance,
    Force,
    Length,
    Mass,
    Modulus,
    Roll,
    RotaryDamping,
    RotaryStiffness,
    Stiffness,
    Time,
    Viscosity,
)
from exosight.validation import CONFIG, Name, check_unique

FORMAT = 1
"""Version of system files; a reader takes this one."""

Limit = Annotated[str, Field(max_length=64)] | Annotated[float, Field(ge=-1e9, le=1e9)]
Strain = Literal["torsion_x", "bend_y", "bend_z", "stretch_x", "shear_y", "shear_z"]

Vector = tuple[Distance, Distance, Distance]
Rotation = tuple[Angle, Angle, Angle]
Unit01 = Annotated[float, Field(ge=0, le=1)]
Share = Annotated[float, Field(ge=-1, le=1)]
Sphere = Annotated[int, Field(ge=0, le=100_000)]
ORIGIN = (0.0, 0.0, 0.0)
MOST_RELAXING = 0.999
"""Largest share of the instantaneous modulus that may relax."""

JOINT_COORDINATES = {"fixed": 0, "revolute": 1, "universal": 2, "spherical": 3}
"""Types of joints, and how many coordinates each has."""


def _refuse_unused(table: Any, used: Mapping[str, Collection[str]]) -> None:
    """ValueError for an entry that has no effect in a table of this type, unless it says what holds anyway.

    used   by type: the optional entries that it takes
    """
    optional = set().union(*used.values())
    for field in fields(table):
        if field.name in optional - set(used[table.type]) and getattr(table, field.name) != field.default:
            raise ValueError(f"{field.name}: it has no effect with type {table.type}; leave it out")


@dataclass(frozen=True, config=CONFIG)
class RadiusProfile:
    """A radius along a rod: exactly one of formula, values and csv."""

    unit: Literal["m", "cm", "mm"]
    """of the radii"""
    formula: str | None = None
    """of X, 0 at the base to 1 at the tip, such as "5.8 - 1.8*X" """
    values: (
        Annotated[tuple[Annotated[float, Field(gt=0, le=1e6)], ...], Field(min_length=2, max_length=10_000)]
        | None
    ) = None
    """evenly spaced from base to tip"""
    x: Annotated[tuple[Unit01, ...], Field(min_length=2, max_length=10_000)] | None = None
    """places of the values, from 0 to 1, if they are not evenly spaced"""
    csv: Annotated[str, Field(max_length=255)] | None = None
    """a file beside the system file, with rows X, radius"""
    scale: Annotated[float, Field(gt=0, le=1000)] = 1.0
    """factor on every radius"""

    def __post_init__(self) -> None:
        given = [name for name in ("formula", "values", "csv") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"expected one of formula, values and csv, got {' and '.join(given) or 'none'}")
        if self.x is not None and (self.values is None or len(self.x) != len(self.values)):
            raise ValueError(
                f"x: expected one place for each of the values, got {len(self.x)} places and "
                f"{len(self.values or ())} values"
            )


@dataclass(frozen=True, config=CONFIG)
class JointTable:
    """How a link moves against its parent."""

    type: Literal["revolute", "universal", "spherical", "fixed"]
    """revolute: one hinge; universal: two, about y and then z; spherical: a rotation vector about x, y, z"""
    axis: Literal["x", "y", "z"] = "y"
    """of a revolute joint, in the parent's frame; a positive angle about y turns x towards −z"""
    stiffness: RotaryStiffness = 0.0
    range: tuple[Angle, Angle] | None = None
    limit_stiffness: RotaryStiffness = 5.0
    """of the quadratic penalty beyond the range"""
    damping: RotaryDamping = 0.0
    """acts in motions with inertia"""

    def __post_init__(self) -> None:
        springs = ("stiffness", "range", "limit_stiffness", "damping")
        _refuse_unused(
            self, {"revolute": ("axis", *springs), "universal": springs, "spherical": springs, "fixed": ()}
        )
        if self.range is not None and not self.range[0] < self.range[1]:
            raise ValueError("range: expected the lower angle first")
        if self.range is not None and self.limit_stiffness == 0:
            raise ValueError("limit_stiffness: expected more than 0 where there is a range")


@dataclass(frozen=True, config=CONFIG)
class LinkTable:
    """A rigid, tapered link along its own x axis."""

    length: Length
    radius: tuple[Length, Length]
    """at its base and at its end"""
    parent: Name | None = None
    """the body at whose end it sits; without: the ground"""
    joint: JointTable = JointTable("fixed")
    position: Vector = ORIGIN
    """of its base in the frame of the parent's end"""
    rotation: Rotation = ORIGIN
    """of its base against that frame, as a rotation vector"""
    mass: Mass = 0.0
    """at its middle"""


def _kind_of_radius(radius: Any) -> str:
    return "[table]" if isinstance(radius, dict | RadiusProfile) else "[length]"


Radius = Annotated[
    Annotated[RadiusProfile, Tag("[table]")] | Annotated[Length, Tag("[length]")],
    Discriminator(_kind_of_radius),
]


@dataclass(frozen=True, config=CONFIG)
class RelaxationTable:
    """A mode of a rod's Prony series: a part of its modulus that relaxes."""

    share: Annotated[float, Field(gt=0, lt=1)]
    """of the instantaneous modulus"""
    time: Time


@dataclass(frozen=True, config=CONFIG)
class RodTable:
    """A soft rod along its own x axis."""

    length: Length
    radius: Radius
    young: Modulus
    """what is left of the modulus after long times, of a rod that relaxes"""
    poisson: Annotated[float, Field(gt=-1, le=0.5)] = 0.5
    density: Density = 0.0
    relaxation: Annotated[tuple[RelaxationTable, ...], Field(max_length=16)] = ()
    """Prony series of a viscoelastic rod; acts where times are given"""
    viscosity: Viscosity = 0.0
    """Kelvin–Voigt: stress a rate of strain; acts in motions with inertia"""
    strains: Annotated[tuple[Strain, ...], Field(min_length=1, max_length=6)] = ("bend_y", "stretch_x")
    """that it can take"""
    elements: Annotated[int, Field(ge=1, le=64)] = 5
    """of its quadratic strain functions"""
    points_per_element: Annotated[int, Field(ge=2, le=32)] = 8
    """Gauss points; energy is integrated, and spheres sit, at these and at both ends"""
    parent: Name | None = None
    position: Vector = ORIGIN
    rotation: Rotation = ORIGIN

    def __post_init__(self) -> None:
        check_unique("strains", self.strains)
        shares = sum(mode.share for mode in self.relaxation)
        if shares > MOST_RELAXING:
            raise ValueError(
                f"relaxation: expected shares of at most {MOST_RELAXING:g} in all, got {shares:g}; "
                "the rest of the instantaneous modulus is young"
            )


@dataclass(frozen=True, config=CONFIG)
class SurfaceTable:
    """Geometry that bodies carry: cameras see tubes; contacts are of tubes and planes, or of spheres."""

    type: Literal["tube", "spheres", "plane"]
    bodies: Annotated[tuple[Name, ...], Field(max_length=1000)] = ()
    """one rod, or links in a chain; of a plane one link, or none: the world"""
    at: Annotated[tuple[Unit01, ...], Field(min_length=1, max_length=1000)] | None = None
    """places of spheres along each link, 0 at its base to 1 at its end; a rod has one at each point"""
    shade: Unit01 = 0.5
    """gray of a tube, 0 black to 1 white"""
    position: Vector = ORIGIN
    """of a point on a plane, in the frame of its link's base"""
    normal: tuple[Share, Share, Share] = (0.0, 0.0, 1.0)
    """direction out of a plane, there"""

    def __post_init__(self) -> None:
        _refuse_unused(self, {"tube": ("shade",), "spheres": ("at",), "plane": ("position", "normal")})
        if self.type != "plane" and not self.bodies:
            raise ValueError(f"bodies: expected at least one body that carries the {self.type}, got none")
        if not any(self.normal):
            raise ValueError("normal: expected a direction such as [0, 0, 1], got no direction")


@dataclass(frozen=True, config=CONFIG)
class ContactTable:
    """Two surfaces that press on each other: both of spheres, or tubes and at most one plane; one name twice
    is a rod that presses on itself."""

    first: Name
    second: Name
    stiffness: Stiffness | None = None
    """of a pair of spheres, and of links with links or planes"""
    line_stiffness: Modulus | None = None
    """of rods: force a length and a depth; without: π/4 young/(1 − poisson²) of the rods, in series"""
    friction: Annotated[float, Field(ge=0, le=10)] | None = None
    """Coulomb's coefficient; without: no friction"""
    damping: ContactDamping | None = None
    """Hunt and Crossley's: share of the normal force a speed of approach; acts in motions with inertia;
    without: none"""


@dataclass(frozen=True, config=CONFIG)
class ActuatorTable:
    """What acts on a body, commanded by one channel."""

    type: Literal["pressure_line", "cable", "joint_torque"]
    """pressure_line pushes along a line on a rod, cable pulls, joint_torque turns a link's joint"""
    range: tuple[str, str]
    """smallest and largest command, such as ["0 N", "4 N"] or ["0 kPa", "80 kPa"]"""
    body: Name
    """the rod, or the link behind the joint"""
    rate: str | None = None
    """largest change a second, such as "10 N/s" """
    drive: str | None = None
    """command at the far end of a dataset's paths; without: the end of the range that is further from 0"""
    gain: str | None = None
    """newtons (or N m) a unit of command, such as "0.05 N/kPa"; not needed where the command is a force"""
    angle: Angle = 1.5707963267948966
    """where a line starts around its rod, from the y axis towards the z axis; 90 deg is on top"""
    turns: Annotated[float, Field(ge=-100, le=100)] = 0.0
    """of a line around its rod, from base to tip"""
    offset: Length | None = None
    """of a line from its rod's axis; without: on the rod's surface"""
    coordinate: Annotated[int, Field(ge=0, le=2)] = 0
    """which coordinate of the joint is turned"""

    def __post_init__(self) -> None:
        line = ("angle", "turns", "offset")
        _refuse_unused(self, {"pressure_line": line, "cable": line, "joint_torque": ("coordinate",)})


@dataclass(frozen=True, config=CONFIG)
class SensorTable:
    """A named scalar, or a row of them along a tube."""

    type: Literal["contact_force", "net_force", "joint_angle", "force_per_length", "centre_of_pressure"]
    surface: Name | None = None
    """that is pressed on, of a plane all; of a force per length or a centre of pressure: a tube"""
    spheres: Annotated[tuple[Sphere, ...], Field(min_length=1, max_length=1000)] | None = None
    """of a contact force: the zone, as numbers of spheres on that surface"""
    at: Annotated[Distance, Field(ge=0)] | None = None
    """of a contact force or a centre of pressure on a tube: the zone's middle, as a distance along it;
    neighbours share forces; without: the centre of pressure of all of the tube"""
    places: Annotated[int, Field(ge=2, le=200)] | None = None
    """of a force per length: how many zones of equal length the tube has; sensor NAME_0 is of the first"""
    component: Component = "magnitude"
    """of a contact force or a force per length: of all of it, or of its normal or tangential part"""
    body: Name | None = None
    """of a joint angle: the link behind the joint; of a contact force: all spheres on it are the zone"""
    coordinate: Annotated[int, Field(ge=0, le=2)] = 0
    """of a joint angle: which coordinate of the joint"""
    parts: Annotated[tuple[Name, ...], Field(min_length=1, max_length=1000)] | None = None
    """of a net force: the sensors that it sums"""
    estimated: bool = False
    """whether networks estimate it from images"""
    limit: Force | None = None
    """largest force that control may allow"""

    def __post_init__(self) -> None:
        _refuse_unused(
            self,
            {
                "contact_force": ("surface", "spheres", "at", "body", "component", "estimated", "limit"),
                "net_force": ("parts", "limit"),
                "joint_angle": ("body", "coordinate", "estimated"),
                "force_per_length": ("surface", "places", "component"),
                "centre_of_pressure": ("surface", "at"),
            },
        )
        needed = {
            "net_force": ("parts",),
            "joint_angle": ("body",),
            "force_per_length": ("surface", "places"),
        }.get(self.type, ("surface",))
        for entry in needed:
            if getattr(self, entry) is None:
                raise ValueError(f"expected {entry} for a sensor of type {self.type}, got none")
        zone = [name for name in ("spheres", "body", "at") if getattr(self, name) is not None]
        if len(zone) > 1:
            raise ValueError(f"expected the zone as one of spheres, body and at, got {' and '.join(zone)}")
        check_unique("parts", self.parts or ())


@dataclass(frozen=True, config=CONFIG)
class CameraTable:
    """A camera that looks along y at the x–z plane: orthographic, or with a distance in perspective."""

    centre: tuple[Distance, Distance]
    """x and z of what is in the middle of the image"""
    pixel: Length
    """side of a pixel in the world; in perspective, at the centre"""
    width: Annotated[int, Field(ge=16, le=LARGEST_SIDE)] = 128
    height: Annotated[int, Field(ge=16, le=LARGEST_SIDE)] = 128
    roll: Roll = 0.0
    """by which the image is turned clockwise about its middle"""
    distance: Annotated[Length, Field(ge=0.01)] | None = None
    """from the pinhole of a perspective camera to the centre; its focal length is distance/pixel [pixels]"""
    pan: Aside = 0.0
    """by which the pinhole goes to the right around the centre"""
    tilt: Aside = 0.0
    """by which it then rises above the centre"""
    distortion: Annotated[float, Field(ge=-0.2, le=0.2)] = 0.0
    """of its lens, at the image's corners, as a share of their distance; negative is a barrel"""
    principal: tuple[Offset, Offset] = (0.0, 0.0)
    """where its optical axis meets the image: pixels right of the middle, and below it"""

    def __post_init__(self) -> None:
        if self.distance is None and (self.pan or self.tilt or self.distortion or any(self.principal)):
            raise ValueError(
                "pan, tilt, distortion and principal: expected a pinhole camera with a distance, got none"
            )


@dataclass(frozen=True, config=CONFIG)
class VaryTable:
    """An entry of the file that differs from design to design, drawn evenly between two values."""

    entry: Annotated[str, Field(max_length=200, pattern=r"^[A-Za-z0-9_.]+$")]
    """such as "rods.sleeve.young" or "links.distal.radius.0" """
    low: Limit
    high: Limit


TABLES: Mapping[str, type] = {
    "rods": RodTable,
    "links": LinkTable,
    "surfaces": SurfaceTable,
    "contacts": ContactTable,
    "actuators": ActuatorTable,
    "sensors": SensorTable,
    "cameras": CameraTable,
    "vary": VaryTable,
}
"""Of a system file, by the entry that they stand under."""

Rods = Annotated[dict[Name, RodTable], Field(max_length=256)]
Links = Annotated[dict[Name, LinkTable], Field(max_length=256)]


@dataclass(frozen=True, config=CONFIG)
class Description:
    """A whole system file."""

    format: Literal[1]
    name: Name
    cameras: Annotated[dict[Name, CameraTable], Field(min_length=1, max_length=64)]
    actuators: Annotated[dict[Name, ActuatorTable], Field(min_length=1, max_length=64)]
    sensors: Annotated[dict[Name, SensorTable], Field(min_length=1, max_length=1024)]
    surfaces: Annotated[dict[Name, SurfaceTable], Field(min_length=1, max_length=256)]
    contacts: Annotated[dict[Name, ContactTable], Field(max_length=256)] = Field(default_factory=dict)
    rods: Rods = Field(default_factory=dict)
    links: Links = Field(default_factory=dict)
    gravity: tuple[Acceleration, Acceleration, Acceleration] | None = None
    """on the masses of links and the density of rods"""
    visibility: Visibility = "depth"
    """which of several tubes cameras show: depth, the nearest surface; stacked, the last one in the file"""
    vary: Annotated[tuple[VaryTable, ...], Field(max_length=64)] = ()
    """what differs from design to design of a dataset"""

    def __post_init__(self) -> None:
        if self.format != FORMAT:
            raise ValueError(f"format: expected {FORMAT}, got {self.format}")
        check_unique("rods and links", [*self.rods, *self.links])
        if not self.rods and not self.links:
            raise ValueError("expected at least one rod or link, got none")
