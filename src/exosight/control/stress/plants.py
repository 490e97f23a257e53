"""The systems of a stress run: the one that controllers are tuned for, and those that come instead."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

from exosight.arrays import floats
from exosight.control.paths import ControllerConfig
from exosight.control.trials import CONTROL_SHAPE, STEADY_STATE_GAIN
from exosight.control.tuning import tune
from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit, varied
from exosight.exosuit.published import Preset, PublishedDesigns
from exosight.exosuit.variation import PlantVariation, draw_variant
from exosight.mechanics import Rod
from exosight.mechanics.relaxation import relaxation
from exosight.mechanics.tree import Tree
from exosight.system.camera import Camera
from exosight.system.design import Design
from exosight.system.designs import DesignSet, FileDesigns
from exosight.system.system import System

Limits = tuple[float, float]

PUBLISHED_TARGETS = (0.1, 0.4)
"""Targets of the published system by default [N]."""
PUBLISHED_SNAP_TARGETS = (0.26, 0.34)
"""Constant targets around the jump of the published system's F_net [N]."""
PUBLISHED_VARIATION = PlantVariation(
    link_length=(0.97, 1.03),
    finger_radius=(0.95, 1.05),
    joint_stiffness=(0.8, 1.25),
    young=(0.8, 1.25),
    gap=(0.0, 0.0005),
    mount_angle=(-0.02, 0.02),
    mount_offset=(-0.002, 0.002),
)
"""By how much exosuit, finger and mount of the published system differ from those that were tuned for."""

_TARGETS = (0.15, 0.7)  # shares of the largest reading within the limits, for a system of a file
_AROUND_SNAP = (0.92, 1.03)  # of the readings before and after the largest jump


@dataclass(frozen=True)
class StressPlants:
    """What a stress run is about.

    limits        model of the nominal system that the controllers have
    nominal       the system that they were tuned for
    other         a system that differs from it, by (seed, number)
    targets       smallest and largest target by default [the sensor's unit]
    snap_targets  constant targets around the jump of the nominal system [the sensor's unit]
    gain          K_P of the paper's law [channel's unit per sensor's]: the paper's for F_net of its exosuit,
                  whichever preset; else what suits the path
    """

    limits: ControllerConfig
    nominal: System
    other: Callable[[int, int], System]
    targets: Limits
    snap_targets: Limits
    gain: float


def stress_plants(
    designs: DesignSet, camera: Camera | None = None, sensor: str | None = None, channel: str | None = None
) -> StressPlants:
    """The paper's exosuit and its wearers for the published system; for a file, its system and designs.

    camera   of the published system, by default the nominal one; a file names its own
    sensor, channel   as for `exosight.control.tuning.tune`

    Raises InputError for another set of designs, or a system that cannot be tuned.
    """
    if isinstance(designs, FileDesigns):
        return _of_file(designs, sensor, channel)
    if not isinstance(designs, PublishedDesigns):
        raise InputError(f"stress: expected the published system or a system file, got {designs.name}")
    exosuit, camera = Exosuit(CONTROL_SHAPE), camera or Camera()
    nominal = designs.preset(exosuit, camera)
    limits = tune(nominal, sensor, channel)
    other = _others(designs.preset, exosuit, camera)
    if limits.sensor == nominal.schema.controlled:
        return StressPlants(
            limits, nominal, other, PUBLISHED_TARGETS, PUBLISHED_SNAP_TARGETS, STEADY_STATE_GAIN
        )
    return StressPlants(limits, nominal, other, *_targets(limits), limits.default_gain)


def _others(preset: Preset, exosuit: Exosuit, camera: Camera) -> Callable[[int, int], System]:
    def other(seed: int, number: int) -> System:
        return preset(varied(exosuit, draw_variant(PUBLISHED_VARIATION, seed, number)), camera)

    return other


def _of_file(designs: FileDesigns, sensor: str | None, channel: str | None) -> StressPlants:
    nominal = designs.build(designs.nominal())
    limits = tune(nominal, sensor, channel)

    @lru_cache(maxsize=16)
    def drawn(seed: int, count: int) -> tuple[Design, ...]:
        return designs.draw(count, seed)

    def other(seed: int, number: int) -> System:
        # Design k is the same however many are drawn; as many as the next power of two are drawn but once.
        return designs.build(drawn(seed, 1 << number.bit_length())[number])

    return StressPlants(limits, nominal, other, *_targets(limits), limits.default_gain)


def _targets(limits: ControllerConfig) -> tuple[Limits, Limits]:
    """Targets, and those around the largest jump, from the path that was tuned on."""
    largest = float(limits.loading.controlled.max())
    targets = _TARGETS[0] * largest, _TARGETS[1] * largest
    jumps = limits.loading.jumps
    if not jumps:
        return targets, targets
    before, after = max(jumps, key=lambda jump: abs(jump[1] - jump[0]))
    return targets, (_AROUND_SNAP[0] * before, _AROUND_SNAP[1] * max(before, after))


@dataclass(frozen=True)
class Creep:
    """Of rods whose stress relaxes: a standard linear solid.

    share   of the instantaneous modulus that relaxes [-]; what is left is the modulus of the system
    time    in which it relaxes [s]
    """

    share: float
    time: float


def with_friction_and_creep(system: System, friction: float | None, creep: Creep | None) -> System:
    """The system with Coulomb friction in all contacts of two bodies, and rods that relax; with None it stays
    as it is there.

    friction   coefficient [-]

    Raises InputError for a share that is not above 0.
    """
    if friction is not None:
        contacts = tuple(
            contact if contact.first == contact.second else replace(contact, friction=floats(friction))
            for contact in system.contacts
        )
        system = replace(system, contacts=contacts)
    if creep is not None:
        tree, clock = Tree(system.bodies), len(system.actuators)
        rods = (body.name for body in system.bodies if isinstance(body, Rod))
        relaxing = tuple(relaxation(rod, [creep.share], [creep.time], clock, tree) for rod in rods)
        system = replace(system, relaxations=relaxing)
    return system
