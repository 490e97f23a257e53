"""What one image of `index-friction` tells, and what past images add: writes docs/results/friction_view.json.

`python docs/identifiability_friction.py` takes half a minute on two cores; figures_identifiability.py shows
it. With friction a pose depends on the path to it, so derivatives are differences of whole paths, 0 → 4 →
0 N; half the steps change what is told by 1 %.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from identifiability import NOISE, PARAMETERS, Prior, measured, system_at
from jaxtyping import Float

from exosight.arrays import floats
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.shapes import ExosuitShape, Linear
from exosight.mechanics import drive
from exosight.system.system import System

RESULT = Path(__file__).parent / "results" / "friction_view.json"
SHAPES = {
    "taper of 9.5 to 5.5 mm, 95 mm long": ExosuitShape(Linear(r0=0.0095, r1=0.0055), length=0.095),
    "taper of 10 to 5 mm, 95 mm long (controller)": ExosuitShape(Linear(r0=0.01, r1=0.005), length=0.095),
}
FRICTION, SPREAD = 0.3, 0.6 / np.sqrt(12)
"""μ, and the standard deviation of an even spread over 0…0.6."""
PEAK, TURNED, TURN = 4.0, 3.9, 1.0
"""Where the path turns, where it turns in the differences, and how well that is known [N]."""
UP = np.arange(0, 81) / 20
LOADS = np.concatenate([UP, UP[-2::-1]])
"""u [N]."""
EVERY = 5
"""Past images are this many loads apart, 0.25 N."""
GEOMETRY = [i for i, name in enumerate(PARAMETERS) if name == "length" or name.startswith("radius")]
STEPS = {"length": 2e-4, "radius": 2e-5, "friction": 0.01}


class Slopes(NamedTuple):
    """Derivatives along a path by u of the same moment, and by what they all share, in units of the prior."""

    own: Float[np.ndarray, "loads numbers"]
    shared: Float[np.ndarray, "loads numbers shared"]


def system_of(exosuit: Exosuit, p: Float[np.ndarray, " parameters"], friction: float) -> System:
    """`index-friction` of an exosuit changed by p."""
    system = system_at(exosuit, p, surfaces=True)
    press, fold = system.contacts
    return replace(system, contacts=(replace(press, friction=floats(friction)), fold))


def slopes(exosuit: Exosuit) -> tuple[Slopes, Slopes, Float[np.ndarray, "loads contacts"]]:
    """Of the outline across itself [m] and of the contact forces [N], and the forces themselves."""
    none = np.zeros(len(PARAMETERS))
    systems, scales = [system_of(exosuit, none, FRICTION)] * 2, []
    prior = Prior().deviations()
    for i in GEOMETRY:
        step = STEPS[PARAMETERS[i].split("_")[0]]
        change = np.where(np.arange(len(none)) == i, step, 0.0)
        systems += [system_of(exosuit, sign * change, FRICTION) for sign in (1, -1)]
        scales.append(prior[i] / (2 * step))
    step = STEPS["friction"]
    systems += [system_of(exosuit, none, FRICTION + sign * step) for sign in (1, -1)]
    scales.append(SPREAD / (2 * step))
    loads = np.repeat(LOADS[None, :, None], len(systems), axis=0)
    loads[1] = np.minimum(loads[1], TURNED)
    found = drive([system.robot for system in systems], loads)
    of_path = jax.jit(
        jax.vmap(measured, in_axes=(None, 0, 0)), compiler_options={"xla_backend_optimization_level": 0}
    )
    seen = [
        [np.asarray(part) for part in of_path(system, found.q[i], tuple(m[i] for m in found.history))]
        for i, system in enumerate(systems)
    ]
    across, forces = seen[0][1], seen[0][2]
    results = []
    for k in (0, 2):
        values = [part[k] for part in seen]
        if k == 0:
            values = [np.sum(across * points, axis=2) for points in values]
        by_u = np.gradient(values[0], axis=0) / np.gradient(np.arange(len(LOADS)) / 20.0)[:, None]
        # Forwards in u on the way up, and backwards on the way down.
        by_u[len(UP) :] *= -1
        turn = (values[0] - values[1]) / (PEAK - TURNED) * TURN
        # Shifts across the outline at the reference: its own directions were held.
        others = [scale * (values[2 * j + 2] - values[2 * j + 3]) for j, scale in enumerate(scales)]
        results.append(Slopes(by_u * prior[0], np.stack([*others, turn], axis=2)))
    return results[0], results[1], forces


def told(
    outline: Slopes,
    force: Slopes,
    images: list[int],
    known: int | None = None,
    metres_per_pixel: float = 0.0011,
) -> Float[np.ndarray, " forces"]:
    """Standard deviations of the contact forces and of F_net at the last of some images, given all [N].

    known   number of a shared unknown that is known
    """
    shared = [i for i in range(outline.shared.shape[2]) if i != known]
    rows = []
    for place, k in enumerate(images):
        own = np.zeros((outline.own.shape[1], len(images)))
        own[:, place] = outline.own[k]
        rows.append(np.column_stack([own, outline.shared[k][:, shared]]))
    seen = np.concatenate(rows) / (NOISE * metres_per_pixel)
    last = np.zeros((force.own.shape[1], seen.shape[1]))
    last[:, len(images) - 1] = force.own[images[-1]]
    last[:, len(images) :] = force.shared[images[-1]][:, shared]
    last = np.vstack([last, last.sum(axis=0)])
    _, size, directions = np.linalg.svd(seen)
    strength = np.zeros(seen.shape[1])
    strength[: len(size)] = size
    return np.linalg.norm(last @ directions.T / np.sqrt(1 + strength**2), axis=1)


def measure(exosuit: Exosuit) -> dict[str, dict[str, list[float]]]:
    """Medians over the loads with contact, on the way up and down: of F_net, and of the worst zone [N]."""
    outline, force, forces = slopes(exosuit)
    friction = len(GEOMETRY)
    found = {}
    for way, places in (("rising", range(10, 80, 5)), ("falling", range(85, 155, 5))):
        pressed = [k for k in places if forces[k].sum() > 0]
        past = {k: sorted({*range(10, k, EVERY), k}) for k in pressed}
        cases = {
            "one image, μ known": [told(outline, force, [k], friction) for k in pressed],
            "one image": [told(outline, force, [k]) for k in pressed],
            "with past images": [told(outline, force, past[k]) for k in pressed],
        }
        found[way] = {
            name: [float(np.median([s[-1] for s in values])), float(np.median([max(s[:-1]) for s in values]))]
            for name, values in cases.items()
        }
    return found


def main() -> None:
    """Write the numbers."""
    found = {name: measure(Exosuit(shape)) for name, shape in SHAPES.items()}
    RESULT.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
