"""Poses of a rig at its pictures' commands, and how they and the readings depend on what is unknown.

The pose q of a picture is a stable equilibrium, ∇Π(q; p) = 0, so dq/dp follows from the implicit function
theorem (`exosight.mechanics.sensitivity`). A system's numbers are closed expressions of the entries of its
file, most of them linear; their slopes are central differences, exact to about 1e-9.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.mechanics import Equilibria, State, advance, initial_state
from exosight.mechanics.sensitivity import SNAP, differentiable_unchecked
from exosight.rig.identification.distances import view_of
from exosight.rig.identification.parameters import Parameter, values_at
from exosight.system.build import build, first_camera
from exosight.system.camera import Camera
from exosight.system.description import Description
from exosight.system.file import Values, describe
from exosight.system.observation import observe_state
from exosight.system.surfaces import SphereSurface
from exosight.system.system import System

LANES = 8
"""Poses that are solved side by side; a multiple of it is asked for always, so that it is compiled once."""
STEP = 1e-4
"""Of the central differences, in deviations of the prior."""


class Numbers(NamedTuple):
    """All numbers of a rig: its system, and its camera's, see `view_of`."""

    system: System
    view: Float[AnyArray, "..."]


class Model:
    """A rig whose parameters are unknown.

    values       entries of its system file
    parameters   which of them are unknown

    Raises InputError for a system with friction or spheres.
    """

    def __init__(self, values: Values, parameters: Sequence[Parameter]) -> None:
        self.values, self.parameters = values, tuple(parameters)
        zero = np.zeros(len(parameters))
        description = describe(values)
        self.nominal, self._cameras = build(description), description.cameras
        if self.nominal.robot.memories:
            raise InputError(
                f"{self.nominal.name}: its contacts have friction, so that poses depend on what was before; "
                "identify it without friction"
            )
        spheres = [each.name for each in self.nominal.surfaces if isinstance(each, SphereSurface)]
        if spheres:
            raise InputError(
                f"{self.nominal.name}: expected contacts of tubes, as loose spheres are not what a device "
                f"touches with, got the spheres {spheres[0]}; describe them as tubes, see the preset index"
            )
        # Most numbers are linear in most entries; what is shows at two places, and is not derived again.
        columns = [(self._slope(zero, i), self._slope(zero + 0.5, i)) for i in range(len(zero))]
        self._linear = {
            i: one
            for i, (one, other) in enumerate(columns)
            if all(map(_same, *map(jax.tree.leaves, (one, other))))
        }

    def numbers(self, x: Float[np.ndarray, " parameters"]) -> Numbers:
        """Those at x, of the nominal system's structure; InputError where there is no system."""
        description = self._description(x)
        system = build(replace(description, cameras=self._cameras))
        return Numbers(system, view_of(first_camera(description)))

    def camera(self, x: Float[np.ndarray, " parameters"]) -> Camera:
        """The camera at x; InputError where there is none."""
        return first_camera(self._description(x))

    def _description(self, x: Float[np.ndarray, " parameters"]) -> Description:
        return describe(values_at(self.values, self.parameters, x))

    def slopes(self, x: Float[np.ndarray, " parameters"]) -> Numbers:
        """Derivatives of the numbers by x, along a last axis: of the system by the parameters before the
        camera's, of the view by all."""
        columns = []
        for i, each in enumerate(self.parameters):
            by_value = self._linear[i] if i in self._linear else self._slope(x, i)
            scale = each.slope(float(x[i]))
            columns.append(jax.tree.map(lambda leaf, scale=scale: scale * leaf, by_value))
        slopes: Numbers = jax.tree.map(lambda *leaves: np.stack(leaves, axis=-1), *columns)
        bodies = sum(not each.entry.startswith("cameras.") for each in self.parameters)
        return Numbers(jax.tree.map(lambda leaf: leaf[..., :bodies], slopes.system), slopes.view)

    def _slope(self, x: Float[np.ndarray, " parameters"], i: int) -> Numbers:
        """Derivatives of the numbers by the number of an entry."""
        ahead, behind = x.copy(), x.copy()
        ahead[i] += STEP
        behind[i] -= STEP
        each = self.parameters[i]
        width = each.value(float(ahead[i])) - each.value(float(behind[i]))

        def change(a: np.ndarray, b: np.ndarray) -> np.ndarray:
            a, b = np.asarray(a), np.asarray(b)
            # Limits may be infinite.
            return np.asarray((np.where(a == b, 0.0, a) - np.where(a == b, 0.0, b)) / width)

        return jax.tree.map(change, self.numbers(ahead), self.numbers(behind))


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(np.allclose(one, other, rtol=1e-7, atol=1e-9 * (1e-300 + np.abs(one).max(initial=0))))


class Response(NamedTuple):
    """What one pose shows, or its derivatives by the parameters along a last axis.

    axes       of each tube (nodes, 3)   [m]
    radii      of each tube (nodes,)     [m]
    readings   (sensors,)
    q          (dofs,)
    """

    axes: tuple[Float[AnyArray, "..."], ...]
    radii: tuple[Float[AnyArray, "..."], ...]
    readings: Float[AnyArray, "..."]
    q: Float[AnyArray, "..."]


@partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})  # compiled in a tenth of the time
def response(
    system: System, slopes: System, command: Float[AnyArray, " channels"], q: Float[AnyArray, " dofs"]
) -> tuple[Response, Response]:
    """What an equilibrium shows, and its derivatives by the parameters that `slopes` are by.

    q   (dofs,)   a stable equilibrium at the command
    """
    count = jax.tree.leaves(slopes)[0].shape[-1]

    def at(x: Array) -> tuple[Response, Response]:
        own = jax.tree.map(lambda leaf, slope: leaf + slope @ x, system, slopes)
        gains = jnp.stack([actuator.gain for actuator in own.actuators])
        moved = differentiable_unchecked(own.robot, gains * command, q)
        seen = observe_state(own, moved)
        tubes = own.tubes
        axes, radii = (
            tuple(seen.axes[tube.name] for tube in tubes),
            tuple(jnp.asarray(tube.radius) for tube in tubes),
        )
        found = Response(axes, radii, jnp.asarray(seen.readings), moved)
        return found, found

    slope, value = jax.jacfwd(at, has_aux=True)(jnp.zeros(count))
    return value, slope


def relaxed(
    system: System,
    commands: Float[np.ndarray, "poses channels"],
    q: Float[np.ndarray, "poses dofs"],
    before: Float[np.ndarray, "poses channels"] | None = None,
) -> tuple[Float[np.ndarray, "poses dofs"], Bool[np.ndarray, " poses"]]:
    """The equilibria at commands that are approached from poses, and which of them are stable.

    before   commands of the poses that the paths start from; by default the commands themselves, for poses
             that are nearly at rest
    """
    count = len(commands)
    fill = np.resize(np.arange(count), -(-count // LANES) * LANES)
    start = State(q[fill], system.loads(commands if before is None else before)[fill])
    found = _advanced([system], start, system.loads(commands)[fill])
    stable = np.asarray(found.converged) & (np.asarray(found.min_eigenvalue) > 10 * SNAP)
    return np.asarray(found.q)[:count], stable[:count]


def at_rest(system: System) -> Float[np.ndarray, " dofs"]:
    """The pose without loads."""
    return np.asarray(initial_state([system.robot] * LANES).q)[0]


def followed(
    system: System, commands: Float[np.ndarray, "poses channels"]
) -> tuple[Float[np.ndarray, "poses dofs"], Bool[np.ndarray, " poses"]]:
    """The equilibria along a path of commands from rest, and which of them are stable."""
    found, stable = [], []
    pose, last = at_rest(system)[None], np.zeros((1, commands.shape[1]))
    for command in commands[:, None]:
        pose, good = relaxed(system, command, pose, last)
        last = command
        found.append(pose[0])
        stable.append(good[0])
    return np.array(found), np.array(stable)


def _advanced(
    systems: Sequence[System], start: State, loads: Float[np.ndarray, "poses channels"]
) -> Equilibria:
    return advance([system.robot for system in systems] * len(loads), start, loads)[1]
