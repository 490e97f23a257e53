"""The controller's knowledge of one's own exosuit, from one path of its simulation up and down.

1. Solve the worn exosuit from rest up, in steps of 0.025 N, to the first load at which a contact presses more
   than it may: the load before is u_max.
2. Solve from there down to u_min, below 0 N, where the pose must have let go.
3. F_net(u) on both is the schedule; its jumps are those that `follow` tells.
4. Δu/ΔF_net is bounded by the slopes ∂F_net/∂u in contact: above by the flattest tenth of them, below by
   half of what the steepest tenth asks for.
"""

import math

import numpy as np

from exosight.control.loop import RATE
from exosight.control.paths import ControllerConfig, ForcePath
from exosight.control.plant import ACTUATION_LIMIT
from exosight.control.scheduled import RELEASED
from exosight.errors import ConvergenceError, InputError
from exosight.exosuit.assembly import Exosuit, assemble, observe
from exosight.mechanics import Equilibria, Robot, State, drive, stack

CONTACT_LIMIT = 0.5
"""Largest force on one contact by default [N]."""
ACTUATION_RATE = 10.0
"""Largest change of u by default [N/s]: from rest to the paper's targets in three steps of 0.1 s."""

PULL = 1.0
"""How far below 0 u may go by default to get out of a pose [N]: as far as the paper's own loop pulls."""

_STEP = 0.025  # [N]: by at most so much a jump is passed; 3 mN on the controller's exosuit


def tune(
    exosuit: Exosuit,
    contact_limit: float = CONTACT_LIMIT,
    rate: float = ACTUATION_RATE,
    limit: float = ACTUATION_LIMIT,
    pull: float = PULL,
    period: float = 1 / RATE,
) -> ControllerConfig:
    """What `Scheduled` needs to know of an exosuit, as it is worn by its finger.

    contact_limit  largest force on each of C1…C7 [N]
    rate           largest change of u a second [N/s]
    limit          largest u of the plant [N]
    pull           −u_min [N]
    period         of a step of the loop [s]

    Raises InputError for a number that is not finite and above 0, or an exosuit that never presses within its
    limits or does not let go at u_min; ConvergenceError if the path has no stable pose at some load.
    """
    for name, value in (
        ("contact limit", contact_limit),
        ("rate", rate),
        ("limit", limit),
        ("pull", pull),
        ("period", period),
    ):
        if not 0 < value < math.inf:
            raise InputError(f"tune, {name}: expected a finite number above 0, got {value}")
    robot = assemble(exosuit)
    grid = np.linspace(0.0, limit, max(2, math.ceil(limit / _STEP)) + 1)
    up, found = _solve(robot, grid, np.zeros(robot.dofs))
    over = (up.forces > contact_limit).any(axis=1)
    last = int(np.argmax(over)) - 1 if over.any() else len(grid) - 1
    if last < 1 or up.net[last] < RELEASED:
        raise InputError(
            f"tune: the exosuit presses less than {RELEASED:g} N before a contact passes "
            f"{contact_limit:g} N or u passes {limit:g} N; allow more, or change its shape"
        )
    loading = ForcePath(up.u[: last + 1], up.forces[: last + 1], up.snapped[: last + 1])
    falling = np.concatenate([grid[last:0:-1], np.linspace(0.0, -pull, max(2, math.ceil(pull / _STEP)) + 1)])
    unloading, _ = _solve(robot, falling, np.asarray(found.q[0, last]))
    if not unloading.net[-1] < RELEASED:
        raise InputError(f"tune: the exosuit still presses at u = {-pull:g} N; allow it a larger pull")
    slopes = np.concatenate([path.slopes.sum(axis=1) for path in (loading, unloading)])
    slopes = slopes[slopes > 1e-3]  # in contact, and not falling
    flat, steep = np.quantile(slopes, [0.1, 0.9])
    return ControllerConfig(
        loading=loading,
        unloading=unloading,
        contact_limit=np.full(7, float(contact_limit)),
        rate=rate,
        period=period,
        smallest_gain=float(0.5 / steep),
        largest_gain=float(1 / flat),
    )


def _solve(robot: Robot, u: np.ndarray, q: np.ndarray) -> tuple[ForcePath, Equilibria]:
    start = State(q[None], u[:1, None])
    found = drive([robot], u[:, None], state=start)
    if not found.converged.all():
        lost = float(u[int(np.argmin(found.converged[0]))])
        raise ConvergenceError(f"no stable pose at u = {lost:g} N; tune with a smaller limit")
    pose = observe(stack([robot]), found.q)
    forces = np.array(pose.forces[0, :, 1:])
    return ForcePath(u, forces, np.array(found.snapped[0])), found
