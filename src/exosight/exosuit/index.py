"""The systems `index` and `index-friction`: the published finger and exosuits, with contact of surfaces.

The exosuit presses along its whole length on tapered links with round ends, and on itself; zones C0 … share
what acts between their middles, which lie where the published spheres are.
"""

from dataclasses import replace

from exosight.arrays import floats
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import NOMINAL_CAMERA, published
from exosight.exosuit.shapes import TABLE_I, ExosuitShape
from exosight.mechanics.surfaces import line_stiffness
from exosight.system.camera import Camera
from exosight.system.sensors import ContactForce, PlaceZone
from exosight.system.system import Contact, System

NAME = "index"
NAME_WITH_FRICTION = "index-friction"
POISSON = 0.5
FRICTION_DRAWN = -0.3, 0.3
"""Limits of the change of the coefficient in datasets of `index-friction`, unless they say otherwise."""


def index(exosuit: Exosuit | ExosuitShape = TABLE_I, camera: Camera = NOMINAL_CAMERA) -> System:
    """The system of one exosuit, with the names of `published`.

    Contact `press` is between the exosuit and the finger, `fold` between the exosuit and itself, half as
    stiff: both sides give way. The exosuit's stiffness of contact follows from its modulus.
    """
    worn = exosuit if isinstance(exosuit, Exosuit) else Exosuit(exosuit)
    return with_surfaces(published(worn, camera), worn)


def with_surfaces(spheres: System, worn: Exosuit) -> System:
    """`published` of an exosuit with contact of surfaces; JAX can differentiate by the system's numbers."""
    middles = floats(worn.finger.sphere_places())
    sensors = tuple(
        ContactForce(sensor.spec, "finger", PlaceZone(number, middles))
        if isinstance(sensor, ContactForce)
        else sensor
        for number, sensor in enumerate(spheres.sensors)
    )
    stiffness = line_stiffness(worn.young, POISSON)
    return replace(
        spheres,
        name=NAME,
        surfaces=spheres.tubes,
        contacts=(
            Contact("press", "exosuit", "finger", floats(stiffness)),
            Contact("fold", "exosuit", "exosuit", floats(stiffness / 2)),
        ),
        sensors=sensors,
        visibility="depth",
    )


def index_friction(exosuit: Exosuit | ExosuitShape = TABLE_I, camera: Camera = NOMINAL_CAMERA) -> System:
    """`index` with Coulomb friction between the exosuit and the finger, of the exosuit's coefficient.

    Measured on skin: 0.61 ± 0.21 on silicone, 0.37 ± 0.09 on nylon (M. Zhang, A. F. T. Mak, In vivo friction
    properties of human skin, Prosthetics and Orthotics International 23, 1999).
    """
    worn = exosuit if isinstance(exosuit, Exosuit) else Exosuit(exosuit)
    smooth = index(worn, camera)
    press, fold = smooth.contacts
    return replace(
        smooth, name=NAME_WITH_FRICTION, contacts=(replace(press, friction=floats(worn.friction)), fold)
    )
