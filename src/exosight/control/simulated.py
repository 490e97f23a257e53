"""The simulated plant: a worn exosuit, followed from equilibrium to equilibrium and rendered."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np

from exosight.control.plant import ACTUATION_LIMIT, Observation
from exosight.errors import ConvergenceError, InputError
from exosight.exosuit.assembly import Exosuit, assemble, observe
from exosight.mechanics import Robot, State, advance, stack
from exosight.system.camera import Camera
from exosight.vision.scene import picture


@dataclass
class SimulatedPlant:
    """Quasi-static: at each actuation the exosuit rests in the stable pose that the path so far leads to.

    As the exosuit snaps between stable poses, the same u can show different forces on the way up and down
    (hysteresis); the same sequence of u always shows the same.

    exosuit  what is simulated
    camera   what looks at it
    limit    largest |u| that it takes [N]

    Raises InputError unless the limit is a finite number above 0.
    """

    exosuit: Exosuit
    camera: Camera = field(default_factory=Camera)
    limit: float = ACTUATION_LIMIT
    _stacked: Robot = field(init=False, repr=False)
    _walk: "Callable[[_Point, float], tuple[_Point, bool]]" = field(init=False, repr=False)
    _now: "_Point | None" = field(init=False, repr=False, default=None)
    _converged: bool = field(init=False, repr=False, default=True)

    def __post_init__(self) -> None:
        if not 0 < self.limit < math.inf:
            raise InputError(f"plant limit: expected a finite number above 0 N, got {self.limit}")
        self._stacked = stack([assemble(self.exosuit)])
        # A loop that swings between two actuations walks the same two ways for ever: they are remembered.
        self._walk = lru_cache(maxsize=8)(partial(_walk, self._stacked))

    def reset(self) -> Observation:
        """Return to u = 0 from the unstrained pose, forgetting the path so far.

        Raises ConvergenceError if the unloaded exosuit has no stable pose.
        """
        rest, converged = self._walk(_Point(0.0, (0.0,) * self._stacked.dofs, 1.0), 0.0)
        if not converged:
            raise ConvergenceError(
                "the unloaded exosuit has no stable pose; check its shape and the finger's"
            )
        self._now, self._converged = rest, converged
        return self.look()

    def apply(self, u: float) -> Observation:
        """Change the actuation to u [N], in steps from the present one, and look at the pose.

        If no stable pose is found at a step, the plant stays in the last one, whose u the observation tells.

        Raises InputError if u is not a number within ±limit.
        """
        self.move(u)
        return self.look()

    def move(self, u: float) -> None:
        """Change the actuation to u [N] without looking: `apply` is this and `look`."""
        if not abs(u) <= self.limit:  # NaN fails here too
            raise InputError(f"actuation u: expected a number within ±{self.limit:g} N, got {u}")
        self._now, self._converged = self._walk(self._present(), float(u))

    def look(self) -> Observation:
        """The pose as it is now."""
        point = self._present()
        q = np.array(point.q)
        pose = jax.tree.map(lambda leaf: leaf[0], observe(self._stacked, jnp.asarray(q[None, None])))
        return Observation(
            u=point.u,
            image=picture(self.exosuit, pose, self.camera)[0],
            forces=np.asarray(pose.forces[0]),
            q=q,
            converged=self._converged,
            min_eigenvalue=point.min_eigenvalue,
        )

    def _present(self) -> "_Point":
        if self._now is None:
            self.reset()
        assert self._now is not None
        return self._now


@dataclass(frozen=True)
class _Point:
    """One equilibrium, hashable by its numbers."""

    u: float
    q: tuple[float, ...]
    min_eigenvalue: float


def _walk(stacked: Robot, start: _Point, u: float) -> tuple[_Point, bool]:
    """The last equilibrium on the way from `start` to u, and whether that is the one at u."""
    state = State(np.array([start.q]), np.array([[start.u]]))
    state, found = advance(stacked, state, np.array([[u]]))
    reached = float(np.asarray(state.loads)[0, 0])
    q = tuple(np.asarray(state.q)[0].tolist())
    return _Point(reached, q, float(found.min_eigenvalue[0])), bool(found.converged[0])
