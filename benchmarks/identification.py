"""Identification of simulated rigs that differ from the model, against their true parameters.

    python -m benchmarks.identification [--rigs 30] [--tilted]

writes docs/results/identification.json, with --tilted identification_tilted.json, which
docs/identification.md shows. Every rig is `index` with another
modulus (± 40 %), joints (± 50 %), links (± 10 %) and camera (moved by up to 10 mm, 10 % nearer or further,
rolled by up to 8°), all drawn evenly. It is pictured at twelve loads; outlines are found in the pictures, and
each point is moved by 0.3 pixels of Gaussian noise in both directions. The system is identified three times:
loads in newtons; loads in an unknown unit with one force reading; and without it.

With --tilted the camera is a pinhole about 30 cm away that is turned by up to 5° in pan and tilt too, and
identified are pictures at loads in newtons: the twelve, and with them twelve more at the load where, by the
first identification, a further one tells most.
"""

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from exosight.app.bench import cpu_name
from exosight.control.trials import CONTROL_SHAPE
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.index import index
from exosight.exosuit.index_file import index_values
from exosight.rig.identification.measurements import Measurements
from exosight.rig.identification.outlines import Outline, outline_of_picture
from exosight.rig.identification.posterior import NORMAL_95
from exosight.rig.identification.result import Identification, identify
from exosight.system.build import build
from exosight.system.camera import Camera
from exosight.system.file import Values, describe
from exosight.system.simulation import simulate_path
from exosight.system.system import System
from exosight.system.units import ANGLE
from exosight.vision.scene import picture

RESULTS = Path(__file__).parents[1] / "docs" / "results"
NOISE = 0.3
"""Of an outline point, in each direction [pixels]."""
LOADS = np.linspace(0.25, 3.0, 12)[:, None]
HELD_OUT = (LOADS[:-1] + LOADS[1:]) / 2
"""Loads [N] of which no picture is taken."""
GAIN = 0.05
"""Of the rig with an actuator in kPa [N/kPa]; the file says twice as much."""
READ = 8
"""Number of the picture with a force reading; its error is FORCE_ERROR."""
FORCE_NOISE = 0.01
"""Of the reading [share]."""
DISTANCE, ASIDE = 0.3, 5.0
"""Of a tilted rig's camera from its centre [m], and up to which it is turned in pan and tilt [deg]."""
FURTHER = 12
"""Pictures where they tell most."""


@dataclass(frozen=True)
class Rig:
    """A rig, its pictures' outlines, and what is true of it: entries of a system file, and F_net [N].

    system     with the nominal camera, so that all rigs are of one structure
    camera     its own
    forces     at HELD_OUT
    reading    of the picture READ
    """

    system: System
    camera: Camera
    outlines: tuple
    truth: dict[str, float]
    forces: Float[np.ndarray, " loads"]
    reading: float


def drawn(number: int, worn: Exosuit, tilted: bool = False) -> Rig:
    """Rig number 0, 1, 2 …, which depends on its number alone."""
    random = np.random.default_rng([19, number])

    def share(width: float) -> float:
        return float(random.uniform(1 - width, 1 + width))

    finger = replace(
        worn.finger,
        lengths=tuple(length * share(0.1) for length in worn.finger.lengths),
        joint_stiffness=tuple(stiffness * share(0.5) for stiffness in worn.finger.joint_stiffness),
    )
    camera = Camera(
        centre=(0.05 + random.uniform(-0.01, 0.01), -0.005 + random.uniform(-0.01, 0.01)),
        metres_per_pixel=0.0011 * share(0.1),
        roll=float(np.deg2rad(random.uniform(-8, 8))),
    )
    rig = replace(worn, finger=finger, young=worn.young * share(0.4))
    if tilted:
        pan, tilt = np.deg2rad(random.uniform(-ASIDE, ASIDE, 2)).tolist()
        nearer = camera.metres_per_pixel / 0.0011  # at one focal length
        camera = replace(camera, distance=nearer * DISTANCE, pan=pan, tilt=tilt)
    system = index(rig)
    path = np.sort(np.concatenate([LOADS, HELD_OUT]), axis=0)
    states = simulate_path(system, path)
    shown = np.isin(path[:, 0], LOADS[:, 0])
    axes = {name: np.asarray(axis)[shown] for name, axis in states.observation.axes.items()}
    outlines = found_in(system, camera, axes, random)
    net = states.observation.readings[:, system.schema.index("F_net")]
    truth = {
        "rods.exosuit.young": rig.young,
        **{f"links.finger_{i}.joint.stiffness": k for i, k in enumerate(finger.joint_stiffness)},
        **{f"links.finger_{i}.length": length for i, length in enumerate(finger.lengths)},
        "rods.exosuit.position.0": 0.0,
        "rods.exosuit.position.2": float(system.robot["exosuit"].mount[2, 3]),
        "rods.exosuit.rotation.1": 0.0,
        "actuators.u.gain": GAIN,
        "cameras.camera.centre.0": camera.centre[0],
        "cameras.camera.centre.1": camera.centre[1],
        "cameras.camera.pixel": camera.metres_per_pixel,
        "cameras.camera.roll": camera.roll,
        "cameras.camera.pan": camera.pan,
        "cameras.camera.tilt": camera.tilt,
    }
    reading = float(net[shown][READ]) * (1 + random.normal(scale=FORCE_NOISE))
    return Rig(system, camera, outlines, truth, np.asarray(net[~shown]), reading)


def found_in(
    system: System, camera: Camera, axes: dict[str, np.ndarray], random: np.random.Generator
) -> tuple[Outline, ...]:
    """The outlines in pictures by a camera, with noise."""
    shades = [tube.shade for tube in system.tubes]
    outlines = []
    for k, each in enumerate(picture(replace(system, cameras=(("camera", camera),)), axes)):
        found = outline_of_picture(each, shades, f"picture {k + 1}")
        moved = random.normal(scale=NOISE, size=found.points.shape)
        outlines.append(replace(found, points=found.points + moved))
    return tuple(outlines)


def further(rig: Rig, number: int, load: float) -> Measurements:
    """The rig's pictures with FURTHER more at a load [N], the noise of each its own."""
    at = int(np.searchsorted(LOADS[:, 0], load))
    loads = np.insert(LOADS[:, 0], at, load)[:, None]
    states = simulate_path(rig.system, loads)
    axes = {
        name: np.repeat(np.asarray(axis)[at : at + 1], FURTHER, axis=0)
        for name, axis in states.observation.axes.items()
    }
    more = found_in(rig.system, rig.camera, axes, np.random.default_rng([20, number]))
    return Measurements(
        np.insert(LOADS[:, 0], [at] * FURTHER, load)[:, None],
        (*rig.outlines[:at], *more, *rig.outlines[at:]),
    )


def in_perspective(values: Values) -> Values:
    """The same file with a pinhole camera, straight ahead."""
    camera = values["cameras"]["camera"]
    return {**values, "cameras": {"camera": {**camera, "distance": f"{DISTANCE} m"}}}


def in_kpa(values: Values) -> Values:
    """The same file with an actuator in kPa, of a gain that is twice the true one."""
    changed = json.loads(json.dumps(values))
    changed["actuators"]["u"] |= {
        "range": [f"{-6 / GAIN} kPa", f"{6 / GAIN} kPa"],
        "drive": f"{4 / GAIN} kPa",
        "gain": f"{2 * GAIN} N/kPa",
    }
    return changed


def compared(rig: Rig, found: Identification, scale: float) -> dict[str, Any]:
    """An identification beside the truth.

    scale   commands a newton
    """
    fitted = build(describe(found.values))
    estimates, noise = {}, {}
    alone = np.sqrt(np.diag(found.posterior.independent))
    for i, each in enumerate(found.estimates):
        unit = ANGLE.units.get(each.unit, 1.0)  # all but angles are in the units of the truth
        own = [unit * number for number in (each.value, each.low, each.high)]
        estimates[each.entry] = (rig.truth[each.entry], *own)
        noise[each.entry] = (own[2] - own[1]) / (2 * NORMAL_95) * float(alone[i]) / each.share

    def factor(entry: str) -> float:
        true, value, *_ = estimates[entry]
        return value / true

    camera, real = fitted.camera, rig.camera
    return {
        "true, found, low, high": estimates,
        "wide": {each.entry: each.share for each in found.estimates},
        "deviation by noise alone": noise,
        "camera": {
            "scale [%]": 100 * abs(camera.metres_per_pixel / real.metres_per_pixel - 1),
            "shift [% of the width]": 100
            * float(np.hypot(*np.subtract(camera.centre, real.centre)))
            / (real.width * real.metres_per_pixel),
            "roll [deg]": float(np.rad2deg(abs(camera.roll - real.roll))),
            "direction [deg]": float(np.rad2deg(np.hypot(camera.pan - real.pan, camera.tilt - real.tilt))),
        },
        "ratios [%]": [
            100 * abs(factor(f"links.finger_{i}.joint.stiffness") / factor("rods.exosuit.young") - 1)
            for i in range(3)
        ],
        "force [%]": force_error(fitted, rig, scale),
        "open": [direction.change for direction in found.open],
        "advised [N]": float(found.commands[np.nanargmax(found.gains), 0]) / scale,
        "noise": found.posterior.noise,
        "points per independent one": found.posterior.crowding,
        "rested": found.rested,
        "elsewhere": list(found.elsewhere),
    }


def force_error(fitted: System, rig: Rig, scale: float) -> float:
    """RMS error of F_net at held-out loads, of its RMS [%]."""
    states = simulate_path(fitted, scale * HELD_OUT)
    net = states.observation.readings[:, fitted.schema.index("F_net")]
    return 100 * float(np.sqrt(np.mean((net - rig.forces) ** 2) / np.mean(rig.forces**2)))


def cases(rig: Rig, worn: Exosuit) -> Iterator[tuple[str, Values, Measurements, bool, float]]:
    """Name, file, measurements, whether gains are known, and commands a newton."""
    values = index_values(worn)
    reading = np.full(len(LOADS), np.nan)
    reading[READ] = rig.reading
    yield "loads in newtons", values, Measurements(LOADS, rig.outlines), True, 1.0
    other = in_kpa(values)
    with_force = Measurements(LOADS / GAIN, rig.outlines, {"F_net": reading})
    yield "one force reading", other, with_force, False, 1 / GAIN
    yield "neither", other, Measurements(LOADS / GAIN, rig.outlines), False, 1 / GAIN


def tilted_cases(
    rig: Rig, worn: Exosuit, number: int, rows: list[dict[str, Any]]
) -> Iterator[tuple[str, Values, Measurements, bool, float]]:
    """The same of a rig with a tilted camera; rows gets what was found of the first case."""
    values = in_perspective(index_values(worn))
    yield "twelve pictures", values, Measurements(LOADS, rig.outlines), True, 1.0
    advised = further(rig, number, rows[0]["advised [N]"])
    yield "twelve more where they tell most", values, advised, True, 1.0


def measure(number: int, worn: Exosuit, tilted: bool) -> list[dict[str, Any]]:
    """Every case of a rig."""
    rig, rows = drawn(number, worn, tilted), []
    chosen = tilted_cases(rig, worn, number, rows) if tilted else cases(rig, worn)
    for name, values, measured, known_gains, scale in chosen:
        begun = time.process_time()
        found = identify(values, measured, known_gains=known_gains)
        seconds = time.process_time() - begun
        rows.append({"rig": number, "case": name, "CPU seconds": seconds, **compared(rig, found, scale)})
        errors = [*rows[-1]["ratios [%]"], *rows[-1]["camera"].values(), rows[-1]["force [%]"]]
        print(number, name, f"{seconds:.0f} s", np.round(errors, 2))
    return rows


def main() -> None:
    """Measure and write, rig by rig."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rigs", type=int, default=30)
    parser.add_argument("--tilted", action="store_true")
    given = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for number in range(given.rigs):
        rows += measure(number, Exosuit(CONTROL_SHAPE), given.tilted)
        jax.clear_caches()  # 80 identifications in one process otherwise exhaust its maps of memory
        result = {"cpu": cpu_name(), "noise [pixels]": NOISE, "rows": rows}
        file = RESULTS / f"identification{'_tilted' * given.tilted}.json"
        file.write_text(json.dumps(result) + "\n")


if __name__ == "__main__":
    main()
