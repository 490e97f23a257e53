"""Where a camera is now, from pictures of the device at rest: its outline without loads, and no force.

The parameters of the camera are fitted as in `fit`, at u = 0; bodies are uncertain within the intervals of
the file, so that those of the camera contain it. A pinhole keeps its lens.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from exosight.rig.identification.fit import Problem, fit
from exosight.rig.identification.measurements import Measurements
from exosight.rig.identification.outlines import Outline
from exosight.rig.identification.parameters import Parameter, Prior, complete, values_at
from exosight.rig.identification.posterior import NORMAL_95, posterior
from exosight.rig.identification.refined import ONE_PICTURE, uncertain
from exosight.rig.identification.response import Model
from exosight.system.build import first_camera
from exosight.system.camera import Camera, project
from exosight.system.file import Values, describe
from exosight.system.observation import body_axes
from exosight.system.system import System
from exosight.system.units import ANGLE, LENGTH

CLEAR = 2.0
"""Deviations of `ONE_PICTURE` beyond which a camera counts as moved: refined estimates take smaller changes
into account."""
LARGEST_MISFIT = 1.0
"""Of the outline of a device at rest, root mean square [pixels]; those of pictures and masks fit to 0.3."""


@dataclass(frozen=True)
class Change:
    """By how much an entry of the camera has changed.

    entry   such as "cameras.side.roll"
    unit    mm, deg, or of the size of a pixel %
    by      how much [unit]
    half    half width of its 95 % interval [unit]
    clear   whether it is beyond this and what refined estimates allow for
    """

    entry: str
    unit: str
    by: float
    half: float
    clear: bool


@dataclass(frozen=True)
class Registered:
    """A camera's place.

    values      entries of the system file with it
    before, after   the camera as the file says, and as the pictures do
    changes     of its entries
    away        by which the axes of the device at rest have moved in the picture, root mean square [pixels]
    misfit      of the outline, root mean square [pixels]
    """

    values: Values
    before: Camera
    after: Camera
    changes: tuple[Change, ...]
    away: float
    misfit: float

    @property
    def moved(self) -> bool:
        """Whether a change is clear."""
        return any(each.clear for each in self.changes)


def register(values: Values, outlines: tuple[Outline, ...], prior: Prior | None = None) -> Registered:
    """The camera that shows a system at rest as pictures do.

    values     entries of its file
    outlines   of pictures without loads, one or more
    prior      how far the camera may have been moved

    Raises InputError for a system with friction or contacts of spheres, ConvergenceError without a pose.
    """
    whole = complete(values)
    wide = Prior() if prior is None else prior
    unknown = tuple(each for each in uncertain(whole, wide) if not each.entry.startswith("actuators."))
    model = Model(whole, unknown)
    commands = np.zeros((len(outlines), len(model.nominal.schema.channels)))
    problem = Problem(model, Measurements(commands, outlines), wide)
    state, _ = fit(problem)
    known = posterior(problem, state)
    places = [i for i, each in enumerate(unknown) if each.entry.startswith("cameras.")]
    camera = tuple(unknown[i] for i in places)
    x = state.x[places]
    moved = values_at(whole, camera, x)
    deviations = np.sqrt(np.diag(known.covariance))[places]
    allowed = {
        each.entry: each.deviation
        for each in uncertain(whole, ONE_PICTURE)
        if each.entry.startswith("cameras.")
    }
    changes = []
    for each, at, deviation in zip(camera, x, deviations, strict=True):
        by, half = each.deviation * float(at), NORMAL_95 * each.deviation * float(deviation)
        clear = abs(by) > max(half, CLEAR * allowed[each.entry])
        unit, size = _shown_in(each)
        changes.append(Change(each.entry, unit, size * by, size * half, clear))
    after = first_camera(describe(moved))
    return Registered(
        values=moved,
        before=model.nominal.camera,
        after=after,
        changes=tuple(changes),
        away=_away(model.nominal, state.q[0], model.nominal.camera, after),
        misfit=float(np.sqrt(np.mean(state.rows.outline**2))),
    )


def _shown_in(parameter: Parameter) -> tuple[str, float]:
    """The unit of a change, and what to multiply with to have it in it."""
    if parameter.size:
        return "%", 100.0
    if parameter.unit in LENGTH.units:
        return "mm", LENGTH.units[parameter.unit] / LENGTH.units["mm"]
    return "deg", ANGLE.units[parameter.unit] / ANGLE.units["deg"]


def _away(system: System, q: Float[np.ndarray, " dofs"], before: Camera, after: Camera) -> float:
    axes = np.concatenate([np.asarray(axis[0]) for axis in body_axes(system, q[None]).values()])
    return float(np.sqrt(np.mean(np.sum((project(after, axes) - project(before, axes)) ** 2, axis=-1))))
