"""One description of a system: bodies, surfaces, contacts, actuators, sensors and cameras, all named.

schema        names, units and ranges of channels, sensors and cameras; travels with every file
description   what a system file may say, in a user's words and units
file          system files: TOML in, a checked description out
units, profile, faults   texts with units, radii along a rod, one sentence for what is wrong
system        what is simulated, from the parts below
surfaces      geometry that bodies carry
sensors       named scalars that are read off a state
camera        named views
observation   what sensors read and where surfaces are, at coordinates of a system
build         a description made into a system, with build_bodies, build_surfaces and build_actuators
designs       systems that differ in numbers: what a dataset is made of
simulation    equilibria of a system under commands

Exported here is what needs no JAX: schema, description and file. The rest is imported from its module.
"""

from exosight.system.camera import Camera
from exosight.system.description import Description
from exosight.system.file import describe, read_system_file, replaced
from exosight.system.schema import (
    Channel,
    Schema,
    SensorSpec,
    ViewSpec,
    difference,
    network_difference,
    schema_from_dict,
    schema_to_dict,
)

__all__ = [
    "Camera",
    "Channel",
    "Description",
    "Schema",
    "SensorSpec",
    "ViewSpec",
    "describe",
    "difference",
    "network_difference",
    "read_system_file",
    "replaced",
    "schema_from_dict",
    "schema_to_dict",
]
