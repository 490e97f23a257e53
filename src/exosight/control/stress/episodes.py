"""One random episode: a target to follow and then to drop, and all that goes wrong meanwhile."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from exosight.control.loop import RATE
from exosight.control.stress.config import KINDS, Kind, StressConfig
from exosight.control.stress.plants import Creep, Limits, StressPlants
from exosight.control.valve import Valve
from exosight.errors import InputError
from exosight.mechanics import Link
from exosight.system.camera import Camera
from exosight.system.system import System


@dataclass(frozen=True)
class Burst:
    """An interval in which images are corrupted.

    first, last  steps, the last one included
    hidden       share of the picture that an object covers; 0: noise instead
    noise        variance of the noise, of full scale
    seed         of its kind and place
    """

    first: int
    last: int
    hidden: float
    noise: float
    seed: int


@dataclass(frozen=True, eq=False)
class Episode:
    """All that happens in an episode, a row a step of 0.1 s.

    kind       of target
    system     the one that is driven, but for friction and creep
    camera     the one that looks at it
    target     (steps,)                [the sensor's unit], 0 from `drop` on
    drop       step at which the target drops to 0
    latency    age of the frames [steps]
    lost       (steps,)                no frame comes
    again      (steps,)                the last frame comes again
    bursts     of noise or occlusion
    stiffness  (steps, coordinates)    of the links' joints [N m/rad]
    rest       (steps, coordinates)    angles at which their springs are slack [rad]
    valve      how late the actuators answer
    friction   coefficient of the contacts of two bodies [-]; None: as the system has it
    creep      of its rods; None: as the system has it
    """

    kind: Kind
    system: System
    camera: Camera
    target: Float[np.ndarray, " steps"]
    drop: int
    latency: int
    lost: Bool[np.ndarray, " steps"]
    again: Bool[np.ndarray, " steps"]
    bursts: tuple[Burst, ...]
    stiffness: Float[np.ndarray, "steps coordinates"]
    rest: Float[np.ndarray, "steps coordinates"]
    valve: Valve
    friction: float | None
    creep: Creep | None

    @property
    def moves(self) -> bool:
        """Whether the user moves."""
        return bool(np.ptp(self.rest, axis=0).any() or np.ptp(self.stiffness, axis=0).any())

    @property
    def displaced(self) -> bool:
        """Whether the camera is not where the system has it."""
        return self.camera != self.system.camera

    def bursts_at(self, step: int) -> list[Burst]:
        """Those in which the image of this step is."""
        return [burst for burst in self.bursts if burst.first <= step <= burst.last]


def draw_episode(config: StressConfig, seed: int, number: int, plants: StressPlants) -> Episode:
    """The episode of this number; it depends on configuration, plants, seed and number alone.

    plants   the nominal one has the camera that the estimator was trained with

    Raises InputError for a negative seed or number.
    """
    if seed < 0 or number < 0:
        raise InputError(f"seed and number: expected whole numbers ≥ 0, got {seed} and {number}")
    rng = np.random.default_rng([seed, number])
    held, after = round(config.hold_seconds * RATE), round(config.release_seconds * RATE)
    steps = held + after
    kind = KINDS[number % len(KINDS)]
    camera = plants.nominal.camera
    system = plants.other(seed, number) if config.wrong_plant else plants.nominal
    springs, share = joint_springs(system)
    friction, creep = _material(config, seed, number)
    x, z, scale = rng.uniform(-1, 1, 3).tolist()
    if config.wrong_camera and number % 3 == 0:
        camera = replace(
            camera,
            centre=(camera.centre[0] + 0.002 * x, camera.centre[1] + 0.002 * z),
            metres_per_pixel=camera.metres_per_pixel * (1 + 0.03 * scale),
        )
    dropped, repeated = rng.uniform(*config.dropped), rng.uniform(*config.repeated)
    lost = rng.random(steps) < dropped
    fastest, slowest = (round(delay * RATE) for delay in config.latency)
    latency = int(rng.integers(fastest, slowest + 1))
    stiffness, rest = _user(rng, steps, springs, share)
    if not config.moving_user or number % 2:
        stiffness, rest = np.tile(springs, (steps, 1)), np.zeros_like(rest)
    return Episode(
        kind=kind,
        system=system,
        camera=camera,
        target=np.append(
            _target(rng, kind, held, config.targets or plants.targets, plants.snap_targets), np.zeros(after)
        ),
        drop=held,
        latency=latency,
        lost=lost,
        again=(rng.random(steps) < repeated) & ~lost,
        bursts=tuple(_burst(rng, steps) for _ in range(config.bursts)),
        stiffness=stiffness,
        rest=rest,
        valve=_valve(config, seed, number),
        friction=friction,
        creep=creep,
    )


def _valve(config: StressConfig, seed: int, number: int) -> Valve:
    """From a generator of its own, so that valves change nothing else of an episode."""
    rng = np.random.default_rng([seed, number, 1])
    found = config.beyond_first
    return Valve(rng.uniform(*found.lag), rng.uniform(*found.dead_time))


def _material(config: StressConfig, seed: int, number: int) -> tuple[float | None, Creep | None]:
    """Friction and creep, likewise; None where no episode has any."""
    rng = np.random.default_rng([seed, number, 2])
    found, (low, high) = config.beyond_first, config.creep_time
    friction, share, place = rng.uniform(*found.friction), rng.uniform(*found.creep), rng.random()
    return (
        friction if found.friction[1] else None,
        Creep(share, low * (high / low) ** place) if found.creep[1] else None,
    )


def _target(
    rng: np.random.Generator, kind: Kind, steps: int, limits: Limits, snap: Limits
) -> Float[np.ndarray, " steps"]:
    """The target of each step until the drop [the sensor's unit]."""
    one, other = rng.uniform(*limits, 2)
    time = np.arange(steps) / RATE
    match kind:
        case "constant":
            return np.full(steps, one)
        case "snap":
            return np.full(steps, rng.uniform(*snap))
        case "steps":
            return np.where(np.arange(steps) < steps // 2, one, other)
        case "ramp":
            return one + (other - one) * np.clip(time / rng.uniform(1.0, 3.0), 0, 1)
        case "sine":
            middle, swing = 0.5 * (one + other), 0.5 * abs(one - other)
            return middle + swing * np.sin(2 * np.pi * (time / rng.uniform(2.0, 5.0) + rng.random()))


def _burst(rng: np.random.Generator, steps: int) -> Burst:
    first = int(rng.integers(steps))
    hidden, noise = rng.uniform(0.05, 0.5), 10 ** rng.uniform(-3, -1)
    covers = rng.random() < 0.5
    return Burst(
        first,
        first + int(rng.integers(10)),
        hidden if covers else 0.0,
        0.0 if covers else noise,
        int(rng.integers(2**31)),
    )


def joint_springs(
    system: System,
) -> tuple[Float[np.ndarray, " coordinates"], Float[np.ndarray, " coordinates"]]:
    """Stiffness of the links' joint coordinates, and the share of the user's motion that each of them takes.

    A joint moves less the more joints lie before it: the knuckle of a finger most.
    """
    links = {body.name: body for body in system.bodies if isinstance(body, Link)}
    stiffness: list[float] = []
    share: list[float] = []
    for link in links.values():
        before, parent = 0, link.parent
        while parent in links:
            before, parent = before + bool(links[parent].joint.dofs), links[parent].parent
        stiffness += np.asarray(link.joint.stiffness, dtype=float).tolist()
        share += [max(round(1 - 0.3 * before, 1), 0.1)] * link.joint.dofs
    return np.array(stiffness), np.array(share)


def _user(
    rng: np.random.Generator,
    steps: int,
    stiffness: Float[np.ndarray, " coordinates"],
    share: Float[np.ndarray, " coordinates"],
) -> tuple[Float[np.ndarray, "steps coordinates"], Float[np.ndarray, "steps coordinates"]]:
    """Joints that stiffen and flex from one second to the next, evenly in between, and rest at first."""
    knots = np.arange(0, steps + RATE, RATE)
    factor = np.exp(rng.uniform(np.log(0.7), np.log(1.4), len(knots)))
    flexed = np.deg2rad(rng.uniform(0.0, 10.0, len(knots)))
    factor[0], flexed[0] = 1.0, 0.0
    at = np.arange(steps)
    return np.interp(at, knots, factor)[:, None] * stiffness, np.interp(at, knots, flexed)[:, None] * share
