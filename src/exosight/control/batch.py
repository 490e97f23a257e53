"""Many simulated plants side by side: each with its own exosuit, its own actuation, its own user."""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from exosight.control.plant import ACTUATION_LIMIT
from exosight.errors import ConvergenceError, InputError
from exosight.exosuit.assembly import QUADRATURE, Exosuit, Pose, assemble, observe
from exosight.exosuit.finger import Finger
from exosight.exosuit.shapes import radius
from exosight.mechanics import JointTorque, Robot, State, advance, stack
from exosight.mechanics.equilibrium import SolverOptions
from exosight.system.camera import Camera
from exosight.vision.renderer import render
from exosight.vision.scene import tubes

_EXACT = SolverOptions()


@dataclass(frozen=True)
class Joints:
    """What the users do with their fingers: springs that are stiffer or softer, and rest elsewhere.

    stiffness  (plants, hinges)   [N m/rad]
    rest       (plants, hinges)   angle at which the spring is slack, positive in flexion [rad]
    """

    stiffness: Float[np.ndarray, "plants hinges"]
    rest: Float[np.ndarray, "plants hinges"]


@dataclass(frozen=True)
class BatchState:
    """All plants at rest, each under its own actuation.

    u          (plants,)        actuation of these very poses [N]: the one asked for, where `converged`
    forces     (plants, 8)      contact force on C0…C7 [N]
    q          (plants, dofs)   coordinates (radians, dimensionless strains)
    converged  (plants,)        False: no stable pose was found on the way, and this is the last one before
    pose       of all plants: shapes and joint angles
    """

    u: Float[np.ndarray, " plants"]
    forces: Float[np.ndarray, "plants 8"]
    q: Float[np.ndarray, "plants dofs"]
    converged: Bool[np.ndarray, " plants"]
    pose: Pose

    @property
    def net_force(self) -> Float[np.ndarray, " plants"]:
        """F_net: the sum over C1…C7 [N]."""
        return self.forces[:, 1:].sum(axis=1)


class BatchPlant:
    """As many `SimulatedPlant`s as exosuits, in one compiled call a step; quasi-static like these.

        plant = BatchPlant([Exosuit(shape) for shape in shapes])
        state = plant.step(np.full(len(shapes), 0.5))  # N
        state.net_force

    exosuits  what is simulated; their fingers have one number of links and hinges
    limit     largest |u| that is taken [N]
    options   of the solver

    Raises InputError for no exosuits, fingers of several structures or a limit that is not finite and above
    0; ConvergenceError if an unloaded exosuit has no stable pose.
    """

    def __init__(
        self,
        exosuits: Sequence[Exosuit],
        limit: float = ACTUATION_LIMIT,
        options: SolverOptions = _EXACT,
    ) -> None:
        if not exosuits:
            raise InputError("plants: expected at least one exosuit, got none")
        if not 0 < limit < np.inf:
            raise InputError(f"plant limit: expected a finite number above 0 N, got {limit}")
        counts = {(len(e.finger.lengths), len(e.finger.joint_stiffness)) for e in exosuits}
        if len(counts) > 1:
            raise InputError("plants: expected fingers of one number of links and hinges, got several")
        self.exosuits, self.limit, self._options = tuple(exosuits), limit, options
        ((_, self._hinges),) = counts
        robots = {exosuit: _movable(exosuit) for exosuit in dict.fromkeys(exosuits)}
        self._own = stack([robots[exosuit] for exosuit in exosuits])
        self._surface = np.stack([radius(e.shape.surface, QUADRATURE.points) for e in exosuits])
        self._finger = np.stack([e.finger.radii for e in exosuits]).astype(float)
        nothing = np.zeros((len(exosuits), 1 + self._hinges))
        unstrained = State(np.zeros((len(exosuits), self._own.dofs)), nothing)
        rest, found = advance(self._own, unstrained, nothing, options)
        if not found.converged.all():
            raise ConvergenceError(
                f"{int((~found.converged).sum())} of {len(exosuits)} unloaded exosuits have no stable pose; "
                "check their shapes and fingers"
            )
        self._at_rest, self._q, self._loads = np.asarray(rest.q), np.asarray(rest.q), nothing
        self._joints = self.resting
        self.reset()

    def __len__(self) -> int:
        return len(self.exosuits)

    @property
    def resting(self) -> Joints:
        """The fingers as their exosuits' configuration has them."""
        stiffness = np.stack([e.finger.joint_stiffness for e in self.exosuits]).astype(float)
        return Joints(stiffness, np.zeros_like(stiffness))

    @property
    def state(self) -> BatchState:
        """All plants as they are now."""
        return self._state

    def reset(self, which: Bool[np.ndarray, " plants"] | None = None) -> BatchState:
        """Return to u = 0 from the unstrained pose, forgetting the path so far; by default all of them."""
        chosen = np.ones(len(self), bool) if which is None else np.asarray(which, bool)
        column, own = chosen[:, None], self.resting
        self._q = np.where(column, self._at_rest, self._q)
        self._loads = np.where(column, 0.0, self._loads)
        self._hold(
            Joints(
                np.where(column, own.stiffness, self._joints.stiffness),
                np.where(column, own.rest, self._joints.rest),
            )
        )
        return self._look(np.ones(len(self), bool))

    def step(self, u: Float[np.ndarray, " plants"], joints: Joints | None = None) -> BatchState:
        """Change every actuation to its u [N], and perhaps the users' joints, infinitely slowly.

        A plant that finds no stable pose on the way stays in the last one, whose u its state tells.

        u       (plants,)   [N]
        joints  by default as they are

        Raises InputError for numbers of another shape or beyond ±limit, or joints that are no springs.
        """
        u = np.asarray(u, dtype=float)
        if u.shape != (len(self),) or not (np.abs(u) <= self.limit).all():  # NaN fails here too
            raise InputError(f"actuation u: expected {len(self)} numbers within ±{self.limit:g} N")
        if joints is not None:
            self._check(joints)
            self._hold(joints)
        end = np.column_stack([u, self._joints.stiffness * self._joints.rest])
        state, found = advance(self._robots, State(self._q, self._loads), end, self._options)
        self._q, self._loads = np.asarray(state.q), np.asarray(state.loads)
        return self._look(np.asarray(found.converged))

    def pictures(
        self, camera: Camera, which: Int[np.ndarray, " frames"] | None = None
    ) -> UInt8[np.ndarray, "frames height width"]:
        """What a camera sees of the plants as they are now, gray 0…255; by default of all, in order."""
        chosen = slice(None) if which is None else which
        pose = self._state.pose
        bodies = (pose.centreline[chosen], self._surface[chosen], pose.finger[chosen], self._finger[chosen])
        return render(tubes(*(np.asarray(part) for part in bodies)), camera)

    def _look(self, converged: Bool[np.ndarray, " plants"]) -> BatchState:
        pose = jax.tree.map(lambda leaf: np.asarray(leaf[:, 0]), observe(self._robots, self._q[:, None]))
        self._state = BatchState(self._loads[:, 0].copy(), pose.forces, self._q.copy(), converged, pose)
        return self._state

    def _check(self, joints: Joints) -> None:
        shape = (len(self), self._hinges)
        if not joints.stiffness.shape == joints.rest.shape == shape:
            raise InputError(f"joints: expected stiffness and rest of shape {shape}, got another")
        if not (np.isfinite(joints.rest).all() and (joints.stiffness > 0).all()):
            raise InputError("joints: expected finite rest angles and stiffness above 0 N m/rad")

    def _hold(self, joints: Joints) -> None:
        """Put the springs into the robots; where they rest is a load."""
        self._joints = joints
        self._robots = eqx.tree_at(
            lambda robots: [robots[Finger.link_name(i)].joint.stiffness for i in range(self._hinges)],
            self._own,
            [jnp.asarray(joints.stiffness[:, i, None]) for i in range(self._hinges)],
        )


def _movable(exosuit: Exosuit) -> Robot:
    """The worn exosuit with a torque at each hinge: k times the angle at which its spring is slack."""
    robot = assemble(exosuit)
    hinges = range(len(exosuit.finger.joint_stiffness))
    torques = tuple(JointTorque(Finger.link_name(i), channel=1 + i) for i in hinges)
    return Robot(robot.bodies, (*robot.terms, *torques))
