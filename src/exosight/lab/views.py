"""One view: the pose, its picture, true and estimated readings; and the path of one channel."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, UInt8

from exosight.control.estimator import Reading
from exosight.dataset.simulation import CROSSING, causes, first_cause
from exosight.lab.estimates import judge, reading_of
from exosight.lab.pictures import camera_image, png_text, tubes_outside
from exosight.lab.pose_cache import STRIDE, CachedSystem, Move, Rest, round125
from exosight.lab.settings import PathSettings, View
from exosight.lab.system import LabSystem
from exosight.mechanics.term import Memories
from exosight.mechanics.tree import Tree
from exosight.system.observation import Observation, observe
from exosight.system.surfaces import zone_radius
from exosight.system.system import System
from exosight.vision.scene import picture

_PART = 16  # steps of a path that are solved in one go


@dataclass(frozen=True)
class ViewResult:
    """All that one view shows.

    system       of the view's design
    rest         the equilibrium, and a shortest drive to it
    observation  of it, without batch dimensions
    image        (height, width)   gray 0…255
    reading      what the network reads off the image, one row; None where it cannot read this system
    notes        why datasets would drop the frame, if they would, and what the camera does not see
    """

    system: System
    rest: Rest
    observation: Observation
    image: UInt8[np.ndarray, "height width"]
    reading: Reading | None
    notes: tuple[str, ...]


def compute_view(view: View, lab: LabSystem) -> ViewResult:
    """Everything that one view shows."""
    cached = lab.cached(view)
    rest = cached.at(lab.moves(view))
    observation = observe_one(cached.stacked, rest.q, rest.history)
    axes = {name: axis[None] for name, axis in observation.axes.items()}
    image = camera_image(view.camera, picture(cached.system, axes))
    reading = lab.network.read(image) if lab.refusal is None else None
    notes = _notes(lab, cached.system, rest, observation) + _outside(view, cached.system, observation)
    return ViewResult(cached.system, rest, observation, image[0], reading, notes)


def observe_one(stacked: System, q: Float[np.ndarray, " dofs"], history: Memories = ()) -> Observation:
    """One stacked system at one state, without batch dimensions."""
    batched = tuple(memory[None, None] for memory in history)
    observation = observe(stacked, jnp.asarray(q)[None, None], batched)
    return jax.tree.map(lambda leaf: np.asarray(leaf)[0, 0], observation)


_NOTES = {
    "not_converged": "no stable pose was found at this command; what is seen is the last one before",
    "crosses_itself": f"{CROSSING}; datasets drop such frames",
}


def _notes(lab: LabSystem, system: System, rest: Rest, observation: Observation) -> tuple[str, ...]:
    """The first cause for which datasets drop this frame, in words."""
    one: Observation = jax.tree.map(lambda leaf: leaf[None, None], observation)
    names = causes(lab.designs)
    cause = int(first_cause(lab.designs, system, np.array([[rest.converged]]), one)[0, 0])
    if cause == len(names):
        return ()
    name = names[cause]
    return (_NOTES.get(name, f"{name.replace('_', ' ')}; datasets drop such frames"),)


def _outside(view: View, system: System, observation: Observation) -> tuple[str, ...]:
    """Which tubes reach beyond the camera image, in words."""
    names = tubes_outside(view.camera, system, observation.axes)
    if not names:
        return ()
    return (f"partly outside the camera image: {', '.join(names)}; the network reads only what is inside",)


def answer(view: View, seen: ViewResult, lab: LabSystem) -> dict[str, Any]:
    """A view as JSON values: millimetres, sensors and commands in their units."""
    reading = seen.reading
    schema = lab.schema
    stops = lab.stops(seen.rest.drive)
    return {
        "drive": stops,
        "notes": seen.notes,
        "scene": scene_of(seen.system, seen.observation),
        "image": png_text(seen.image),
        "readings": readings_of(seen.observation, lab),
        "reading": None if reading is None else reading_of(reading, schema),
        "guard": None if reading is None else judge(seen.image, reading, schema),
        "command": lab.command(View(view.design, stops, view.camera)),
    }


def readings_of(observation: Observation, lab: LabSystem) -> dict[str, float]:
    """True readings by sensor [each in its unit]."""
    return {
        sensor.name: round(float(value), 5)
        for sensor, value in zip(lab.schema.sensors, observation.readings, strict=True)
    }


def scene_of(system: System, observation: Observation) -> dict[str, Any]:
    """What is drawn of a pose: axes and radii of the tubes, forces on the zones; [mm] and [N], x and z."""
    return {
        "tubes": [
            {
                "axis": _millimetres(observation.axes[tube.name][:, ::2]),
                "radius": _millimetres(tube.radius),
            }
            for tube in system.tubes
        ],
        "zones": [
            {
                "at": _millimetres(at[::2]),
                "radius": _millimetres(size),
                "force": [round(float(f), 5) for f in force[::2]],
            }
            for size, at, force in zip(
                _zone_radii(system), observation.places, observation.forces, strict=True
            )
        ],
    }


def _zone_radii(system: System) -> list[float]:
    """Mean radius of the surface in each zone [m]: an arrow stands that far from the zone's middle."""
    surfaces, tree = {surface.name: surface for surface in system.surfaces}, Tree(system.bodies)
    return [float(zone_radius(zone, surfaces[zone.surface], tree)) for zone in system.zones]


def _millimetres(values: Any) -> Any:
    return np.round(1e3 * np.asarray(values, float), 2).tolist()


@dataclass(frozen=True)
class Path:
    """One channel driven from 0 to its peak, then to the other end of its grid, while the others stay.

    before     moves of the other channels
    channel    that is driven
    loading    steps from 0 to the peak
    unloading  steps from the peak to the other end
    """

    before: tuple[Move, ...]
    channel: int
    loading: tuple[int, ...]
    unloading: tuple[int, ...]

    def drives(self) -> list[list[Move]]:
        """One for each place, first of the loading, then of the unloading."""
        peak = (self.channel, self.loading[-1])
        up = [[*self.before, (self.channel, k)] for k in self.loading]
        return up + [[*self.before, peak, (self.channel, k)] for k in self.unloading]

    def parts(self) -> list[list[Move]]:
        """Drives that make the path known, one after the other, each in little time."""
        return self.drives()[:: _PART // STRIDE]


def path_of(settings: PathSettings, lab: LabSystem) -> Path:
    """The path that is asked for."""
    channel = lab.channel(settings.channel)
    last = dict(lab.moves(settings.view))
    grid = lab.grids[channel]
    peak, other = grid.peak, grid.bottom if grid.peak == grid.top else grid.top
    sign = 1 if peak > 0 else -1
    return Path(
        before=tuple((each, steps) for each, steps in sorted(last.items()) if each != channel),
        channel=channel,
        loading=_places(0, peak, sign),
        unloading=_places(peak, other, -sign),
    )


def _places(start: int, end: int, sign: int) -> tuple[int, ...]:
    """Both ends, and every multiple of STRIDE between them."""
    between = [k for k in range(start, end, sign) if k % STRIDE == 0 and k not in (start, end)]
    return (start, *between, *([end] if end != start else []))


def path_answer(settings: PathSettings, path: Path, cached: CachedSystem, lab: LabSystem) -> dict[str, Any]:
    """What one sensor reads along a path, and between which limits a loop may follow it."""
    sensor, grid = lab.sensor(settings.sensor), lab.grids[path.channel]
    rests = [cached.at(drive) for drive in path.drives()]
    history = jax.tree.map(lambda *rows: np.stack(rows)[None], *(rest.history for rest in rests))
    found = observe(cached.stacked, np.stack([rest.q for rest in rests])[None], history)
    values = np.round(np.asarray(found.readings)[0, :, lab.schema.index(sensor.name)], 5)
    turn = len(path.loading)
    most = round125(max(1e-6, float(np.abs(values).max())))
    return {
        "channel": grid.channel.name,
        "sensor": sensor.name,
        "loading": _points(grid.command, path.loading, values[:turn]),
        "unloading": _points(grid.command, path.unloading, values[turn:]),
        "step": grid.command(STRIDE),
        "stable": all(rest.converged for rest in rests),
        "target": {"low": most / 50, "high": most, "step": most / 100, "start": 0.3 * most},
    }


def _points(command: Any, steps: Sequence[int], values: np.ndarray) -> list[tuple[float, float]]:
    return [(command(k), float(value)) for k, value in zip(steps, values, strict=True)]
