"""The published system: a soft exosuit clamped above a finger, as the paper describes it."""

from collections.abc import Callable, Hashable
from dataclasses import fields, replace
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Bool

from exosight.arrays import floats
from exosight.errors import InputError
from exosight.exosuit.assembly import MAX_FORCE, ROD, Exosuit, assemble, varied
from exosight.exosuit.finger import Finger
from exosight.exosuit.scenarios import SCENARIOS, geometry, sample_shapes
from exosight.exosuit.shapes import FAMILIES, TABLE_I, ExosuitShape, shape_from_dict, shape_to_dict
from exosight.exosuit.variation import PlantVariation, Variant, draw_variant
from exosight.mechanics import PressureLine, Robot, SphereContact
from exosight.system.camera import Camera
from exosight.system.design import Design
from exosight.system.designs import Filter
from exosight.system.observation import Observation
from exosight.system.schema import Channel, Schema, SensorSpec
from exosight.system.sensors import ContactForce, JointAngle, NetForce, SphereZone
from exosight.system.surfaces import SphereSurface, TubeSurface
from exosight.system.system import Actuator, Contact, System

NAME = "published"
COMMAND_LIMIT = 6.0
"""Largest |u| that controllers ask for and plants take [N]; not printed in the paper."""
FINGER_SHADE = 0.70
"""Mid gray: apart from the background (0.92) and from the exosuit by equal steps of about 0.3."""
EXOSUIT_SHADE = 0.35
"""Dark gray: the body whose bending carries most of the information stands out most."""
CHANNEL = Channel("u", "N", -COMMAND_LIMIT, COMMAND_LIMIT, drive=MAX_FORCE)
NOMINAL_CAMERA = Camera()
NOMINAL = Exosuit()
NO_VARIATION = PlantVariation()


def published(exosuit: Exosuit | ExosuitShape = TABLE_I, camera: Camera = NOMINAL_CAMERA) -> System:
    """The paper's system of one exosuit.

    Rod `exosuit` and links `finger_0` … ; 42 spheres on the rod against two on each link; one pressure line
    on the surface away from the finger. Sensors: C0 …, the contact force on each finger sphere, of which all
    but C0 are estimated; F_net, their sum; angle_1 …, the flexion of the hinges.
    """
    worn = exosuit if isinstance(exosuit, Exosuit) else Exosuit(exosuit)
    return system_of(assemble(worn), worn.finger, camera)


def system_of(robot: Robot, finger: Finger, camera: Camera = NOMINAL_CAMERA) -> System:
    """The same for a robot of `assemble_surface`; JAX can differentiate by the robot's numbers."""
    line = next(term for term in robot.terms if isinstance(term, PressureLine))
    contact = next(term for term in robot.terms if isinstance(term, SphereContact))
    links = [body.name for body in robot.bodies if body.name != ROD]
    names = [f"C{i}" for i in range(len(contact.second.frames))]
    zones = tuple(
        ContactForce(
            SensorSpec(name, "contact force", "N", estimated=i > 0), "finger_spheres", SphereZone((i,))
        )
        for i, name in enumerate(names)
    )
    hinges = tuple(
        JointAngle(SensorSpec(f"angle_{i + 1}", "joint angle", "rad"), links[i])
        for i in range(len(finger.joint_stiffness))
    )
    return System(
        name=NAME,
        bodies=robot.bodies,
        surfaces=(
            TubeSurface(
                "finger",
                (*((link, 0) for link in links), (links[-1], "end")),
                floats(finger.radii),
                FINGER_SHADE,
            ),
            TubeSurface(
                "exosuit",
                tuple((ROD, i) for i in range(len(contact.first.frames))),
                contact.first.radius,
                EXOSUIT_SHADE,
            ),
            SphereSurface("exosuit_spheres", contact.first),
            SphereSurface("finger_spheres", contact.second),
        ),
        contacts=(Contact("press", "exosuit_spheres", "finger_spheres", contact.stiffness),),
        actuators=(Actuator(CHANNEL, line, floats(1.0)),),
        sensors=(*zones, NetForce(SensorSpec("F_net", "net force", "N", parts=tuple(names[1:]))), *hinges),
        cameras=(("camera", camera),),
        visibility="stacked",
    )


def tip_below_finger(seen: Observation) -> Bool[np.ndarray, "*batch"]:
    """Where the exosuit's tip lies below the fingertip: it has slipped off, or wrapped around it."""
    exosuit, finger = np.asarray(seen.axes["exosuit"]), np.asarray(seen.axes["finger"])
    return exosuit[..., -1, 2] < finger[..., -1, 2]


FILTERS: dict[str, Filter] = {"tip_below_finger": tip_below_finger}
"""What the published dataset leaves out beside what every dataset does."""


Preset = Callable[[Exosuit, Camera], System]
"""The system of an exosuit."""


class PublishedDesigns:
    """The eleven published scenarios of exosuit shapes, with what may vary in finger, material and mount.

    nominal     what every design shares: finger, modulus, contact stiffness, gap, mount; not its shape
    variation   how designs differ besides their shapes
    camera      of every image
    preset      the system of an exosuit and a camera: `published`, or another one of the same parts
    """

    families = tuple(FAMILIES)
    scenarios = tuple(scenario.name for scenario in SCENARIOS)
    filters = FILTERS

    def __init__(
        self,
        nominal: Exosuit = NOMINAL,
        variation: PlantVariation = NO_VARIATION,
        camera: Camera = NOMINAL_CAMERA,
        preset: Preset = published,
    ) -> None:
        self.nominal, self.variation, self.camera, self.preset = nominal, variation, camera, preset

    @property
    def name(self) -> str:
        """Of the system."""
        return self.schema.system

    @property
    def schema(self) -> Schema:
        """That of the nominal exosuit; all have the same."""
        return self._schema

    @cached_property
    def _schema(self) -> Schema:
        return self.preset(self.nominal, self.camera).schema

    def draw(self, per_scenario: int, seed: int) -> tuple[Design, ...]:
        """Distinct shapes of each scenario, see `sample_shapes`; the rest depends on seed and number."""
        return _drawn(per_scenario, seed)

    def exosuit(self, design: Design) -> Exosuit:
        """The worn exosuit of a design."""
        return varied(replace(self.nominal, shape=_shape(design)), self._variant(design))

    def build(self, design: Design) -> System:
        """The system of a design; InputError for parameters that are no shape's."""
        return self.preset(self.exosuit(design), self.camera)

    def numbers(self, design: Design) -> dict[str, float]:
        """The fields of the design's `Variant`, of several numbers with their places; none if none vary."""
        if self.variation == PlantVariation():
            return {}
        numbers: dict[str, float] = {}
        variant = self._variant(design)
        for field in fields(Variant):
            value = getattr(variant, field.name)
            if isinstance(value, tuple):
                numbers |= {f"{field.name}_{k}": part for k, part in enumerate(value)}
            else:
                numbers[field.name] = value
        return numbers

    def key(self, design: Design) -> Hashable:
        """Length and radii, see `geometry`."""
        return geometry(_shape(design))

    def _variant(self, design: Design) -> Variant:
        seed = design.parameters.get("seed")
        if not isinstance(seed, int):
            raise InputError(f"design {design.number}: expected the seed that it was drawn by, got {seed!r}")
        return draw_variant(self.variation, seed, design.number)


@lru_cache(maxsize=2)
def _drawn(per_scenario: int, seed: int) -> tuple[Design, ...]:
    """The designs of a dataset; a process makes many chunks of the same."""
    return tuple(
        Design(
            sampled.shape_id,
            list(FAMILIES).index(sampled.shape.surface.family),
            sampled.scenario,
            {**shape_to_dict(sampled.shape), "seed": seed},
        )
        for sampled in sample_shapes(per_scenario, seed)
    )


def _shape(design: Design) -> ExosuitShape:
    return shape_from_dict({name: value for name, value in design.parameters.items() if name != "seed"})
