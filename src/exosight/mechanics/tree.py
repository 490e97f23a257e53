"""The kinematic tree: links and rods, each attached to the end of another or to the ground."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np

from exosight.errors import InputError
from exosight.mechanics.link import Link
from exosight.mechanics.rod import Rod

Body = Link | Rod


class Tree(eqx.Module):
    """Bodies, parents before children.

    It is a JAX pytree: its numbers can be batched, traced and differentiated, while names and array sizes are
    fixed and select the compiled code.
    """

    bodies: tuple[Body, ...]

    def __init__(self, bodies: tuple[Body, ...]) -> None:
        seen: set[str | None] = {None}
        for body in bodies:
            if body.name in seen:
                raise InputError(f"robot: two bodies are named {body.name!r}; give each its own name")
            if body.parent not in seen:
                raise InputError(
                    f"robot: body {body.name!r} sits on {body.parent!r}, which does not come before it"
                )
            seen.add(body.name)
        self.bodies = tuple(bodies)

    @property
    def dofs(self) -> int:
        """Number of coordinates, body by body in order."""
        return sum(body.dofs for body in self.bodies)

    @property
    def frames(self) -> int:
        """Number of poses, body by body in order."""
        return sum(body.frames for body in self.bodies)

    def __getitem__(self, name: str) -> Body:
        return self.bodies[self.index(name)]

    def index(self, name: str) -> int:
        """Position of the body called `name`; InputError if there is none."""
        names = [body.name for body in self.bodies]
        if name not in names:
            raise InputError(f"robot: no body is named {name!r}; it has {', '.join(names)}")
        return names.index(name)

    def frame_slice(self, name: str) -> slice:
        """Indices of the frames of body `name` among all frames."""
        i = self.index(name)
        start = sum(body.frames for body in self.bodies[:i])
        return slice(start, start + self.bodies[i].frames)

    def frame(self, name: str, number: int) -> int:
        """Index of frame `number` of body `name` (−1: its last) among all; InputError if it has none."""
        own = self.frame_slice(name)
        count = own.stop - own.start
        if not -count <= number < count:
            raise InputError(f"robot: body {name!r} has frames 0…{count - 1}, got {number}")
        return range(own.start, own.stop)[number]

    def dof_slice(self, name: str) -> slice:
        """Indices of the coordinates of body `name` (its joint's, then its strains') among all."""
        i = self.index(name)
        start = sum(body.dofs for body in self.bodies[:i])
        return slice(start, start + self.bodies[i].dofs)

    def moving(self, frames: Sequence[int] | np.ndarray) -> tuple[int, ...]:
        """The coordinates that move any of these frames, ascending."""
        found: set[int] = set()
        for body in self.bodies:
            own = self.frame_slice(body.name)
            if any(own.start <= i < own.stop for i in frames):
                name: str | None = body.name
                while name is not None:
                    dofs = self.dof_slice(name)
                    found.update(range(dofs.start, dofs.stop))
                    name = self[name].parent
        return tuple(sorted(found))
