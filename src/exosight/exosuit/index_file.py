"""The preset `index` as the entries of a system file, so that a rig can start from it and differ."""

from exosight.exosuit.assembly import MAX_FORCE, ROD, Exosuit
from exosight.exosuit.finger import JOINT_LIMIT_STIFFNESS
from exosight.exosuit.index import NAME
from exosight.exosuit.published import COMMAND_LIMIT, EXOSUIT_SHADE, FINGER_SHADE, NOMINAL_CAMERA
from exosight.exosuit.shapes import Linear, radius
from exosight.system.camera import Camera
from exosight.system.description import FORMAT
from exosight.system.file import Values

PROFILE_POINTS = 201
"""Radii in the file of an exosuit that is not linear, evenly spaced."""


def index_values(worn: Exosuit, camera: Camera = NOMINAL_CAMERA) -> Values:
    """The entries of a file that describes `index` of an exosuit: the same equilibria, sensors and pictures.

    Radii of an exosuit that is not linear are interpolated between points, to 1e-8 m.
    """
    finger, shape = worn.finger, worn.shape
    names = [finger.link_name(i) for i in range(len(finger.lengths))]
    links: Values = {}
    for i, name in enumerate(names):
        links[name] = {
            "length": f"{finger.lengths[i]!r} m",
            "radius": [f"{finger.radii[i]!r} m", f"{finger.radii[i + 1]!r} m"],
            **({"parent": names[i - 1]} if i else {}),
        }
        if i < len(finger.joint_stiffness):
            links[name]["joint"] = {
                "type": "revolute",
                "stiffness": f"{finger.joint_stiffness[i]!r} N m/rad",
                "range": [f"{angle!r} rad" for angle in finger.joint_range[i]],
                "limit_stiffness": f"{JOINT_LIMIT_STIFFNESS!r} N m/rad",
            }
    height = finger.radii[0] + float(radius(shape.surface, 0.0)) + worn.gap
    zones = [f"C{i}" for i in range(len(finger.sphere_places()))]
    return {
        "format": FORMAT,
        "name": NAME,
        "rods": {
            ROD: {
                "length": f"{shape.length!r} m",
                "radius": _profile(worn),
                "young": f"{worn.young!r} Pa",
                "density": "1070 kg/m^3",
                "position": [f"{worn.mount_offset!r} m", "0 m", f"{height!r} m"],
                "rotation": ["0 rad", f"{-worn.mount_angle!r} rad", "0 rad"],
            }
        },
        "links": links,
        "surfaces": {
            "finger": {"type": "tube", "bodies": names, "shade": FINGER_SHADE},
            "exosuit": {"type": "tube", "bodies": [ROD], "shade": EXOSUIT_SHADE},
        },
        "contacts": {
            "press": {"first": "exosuit", "second": "finger"},
            "fold": {"first": "exosuit", "second": "exosuit"},
        },
        "actuators": {
            "u": {
                "type": "pressure_line",
                "body": ROD,
                "range": [f"{-COMMAND_LIMIT!r} N", f"{COMMAND_LIMIT!r} N"],
                "drive": f"{MAX_FORCE!r} N",
            }
        },
        "sensors": {
            **{
                zone: {
                    "type": "contact_force",
                    "surface": "finger",
                    "at": f"{place!r} m",
                    **({"estimated": True} if i else {}),
                }
                for i, (zone, place) in enumerate(zip(zones, finger.sphere_places(), strict=True))
            },
            "F_net": {"type": "net_force", "parts": zones[1:]},
            **{
                f"angle_{i + 1}": {"type": "joint_angle", "body": names[i]}
                for i in range(len(finger.joint_stiffness))
            },
        },
        "cameras": {
            "camera": {
                "centre": [f"{middle!r} m" for middle in camera.centre],
                "pixel": f"{camera.metres_per_pixel!r} m",
                "width": camera.width,
                "height": camera.height,
                "roll": f"{camera.roll!r} rad",
            }
        },
    }


def _profile(worn: Exosuit) -> Values:
    surface = worn.shape.surface
    if isinstance(surface, Linear):
        return {"formula": f"(1 - X)*{surface.r0!r} + X*{surface.r1!r}", "unit": "m"}
    places = [i / (PROFILE_POINTS - 1) for i in range(PROFILE_POINTS)]
    return {"values": [float(radius(surface, x)) for x in places], "unit": "m"}
