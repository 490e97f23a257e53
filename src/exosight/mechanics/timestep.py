"""One robot on its way through time: Runge–Kutta steps of the equation of motion until a time is reached.

The equation of motion (`equation_of_motion`) is stepped by an ESDIRK method (`tableau`). Each of its stages
is a nonlinear system of the size of q, solved by Newton's method (`stage_solve`); the step follows a
tolerance (`step_control`). All this is one loop whose body is one Newton step, because a loop over many
robots side by side runs as long as the slowest needs: so each robot is in a stage and a step of its own.

Why not the minimum of an incremental potential with BDF2 in the frames' poses: it is of order 2, and stays
so, because it constrains poses to the tree (index 3). Here 46 steps a second bring the tip of a 30 cm
cantilever to 2 µm; order 2 takes some thousands.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from exosight.arrays import AnyArray
from exosight.mechanics.equation_of_motion import Linearization, equation_of_motion
from exosight.mechanics.integration_state import IntegrationState, Interval
from exosight.mechanics.robot import Robot
from exosight.mechanics.rotation_wrap import wrap_rotations
from exosight.mechanics.stage_solve import (
    NewtonStep,
    begin_newton,
    newton_point,
    newton_step,
    next_newton,
    stage_of,
)
from exosight.mechanics.step_control import (
    ROUND_OFF,
    StepLimits,
    after_divergence,
    after_step,
    first_step,
    fitted_step,
    step_error,
)
from exosight.mechanics.tableau import ARK4_IMPLICIT

TABLEAU = ARK4_IMPLICIT


def integrate(
    robot: Robot,
    state: IntegrationState,
    interval: Interval,
    until: Float[AnyArray, ""],
    limits: StepLimits,
) -> IntegrationState:
    """The state at a time of the interval, or where the robot gave up."""
    stepper = TimeStepper(robot, interval, limits, equation_of_motion(robot))
    most = state.steps + state.rejected + limits.max_steps

    def unfinished(state: IntegrationState) -> Array:
        return jnp.logical_and((state.time < until) | (state.stage == 0), ~state.failed)

    def further(state: IntegrationState) -> IntegrationState:
        state = stepper.advance(state)
        spent = (state.steps + state.rejected >= most) & (state.time < until)
        return state._replace(failed=state.failed | spent)

    state = state._replace(proposed=jnp.minimum(state.proposed, limits.largest))
    return jax.lax.while_loop(unfinished, further, stepper.with_step(state))


@dataclass(frozen=True)
class TimeStepper:
    """What is constant over an interval: the robot but for its memories, its equation of motion if it has
    none, loads and limits.
    """

    robot: Robot
    interval: Interval
    limits: StepLimits
    linearize: Callable[..., Linearization]

    def advance(self, state: IntegrationState) -> IntegrationState:
        """One Newton step; where it ends a stage or a step, the next one is begun."""
        time = state.time + jnp.asarray(TABLEAU.nodes)[state.stage] * state.step
        y = jnp.stack([jnp.asarray(state.q), jnp.asarray(state.v)])
        stage = stage_of(TABLEAU, state.stage, state.step, y, state.slopes)
        q, v, eta = newton_point(stage, state.newton.a)
        robot, linearize = self.robot, self.linearize
        if state.memories:
            robot = robot.with_memories(state.memories)
            linearize = equation_of_motion(robot)
        loads = self.interval.load_at(time)
        here = linearize(q, v, jnp.asarray(state.newton.a), loads, eta)
        found = newton_step(stage, here, state.newton, self.limits.tolerance)

        state = state._replace(newton=next_newton(state.newton, found))
        solved = _with_stage(state, found, here)
        error = step_error(TABLEAU, solved.slopes, state.step, here.displacement)
        discrepancy = robot.discrepancy(here.motion, found.v, loads)
        if discrepancy is not None:
            error = jnp.maximum(error, 0.5 * state.step * discrepancy)
        good, proposed = after_step(self.limits, state.step, error, TABLEAU.order)
        explicit, last = state.stage == 0, state.stage == TABLEAU.stages - 1
        ended = self.remembering(solved, here, loads)
        shorter = after_divergence(self.limits, state.step)
        return _first_case(
            (found.diverged, self.rejected(state, shorter)),
            (~found.converged, state),
            (explicit, self.started(ended, found, here)),
            (~last, solved),
            (good, self.accepted(ended, found, here, proposed)),
            otherwise=self.rejected(state, proposed),
        )

    def started(self, state: IntegrationState, found: NewtonStep, here: Linearization) -> IntegrationState:
        """The acceleration at the start is known: the first step begins."""
        first = first_step(self.limits, here.displacement(found.a))
        proposed = jnp.where(jnp.isinf(state.proposed), first, state.proposed)
        return self.with_step(self.with_energies(state, found, here)._replace(proposed=proposed))

    def accepted(
        self,
        state: IntegrationState,
        found: NewtonStep,
        here: Linearization,
        proposed: Float[Array, ""],
    ) -> IntegrationState:
        """The step's last stage is the new point, and the first stage of the next step."""
        weights = TABLEAU.weights
        dissipated = weights @ state.dissipation
        supplied = weights @ (state.forces @ self.interval.load_rate)
        time, end = state.time + state.step, self.interval.end
        # Where rotations or memories are rewritten, the acceleration is found anew, by the explicit stage.
        q, v, rewritten = wrap_rotations(self.robot, found.q, found.v)
        state = self.with_energies(state, found, here)
        return self.with_step(
            state._replace(
                time=jnp.where(end - time < ROUND_OFF * self.interval.span, end, time),
                q=q,
                v=v,
                energies=state.energies._replace(
                    dissipated=state.energies.dissipated + state.step * dissipated,
                    supplied=state.energies.supplied + state.step * supplied,
                ),
                proposed=proposed,
                stage=jnp.where(rewritten | bool(state.memories), 0, 1),
                slopes=jnp.asarray(state.slopes).at[0].set(state.slopes[-1]),
                forces=jnp.asarray(state.forces).at[0].set(state.forces[-1]),
                dissipation=jnp.asarray(state.dissipation).at[0].set(state.dissipation[-1]),
                steps=state.steps + 1,
            )
        )

    def rejected(self, state: IntegrationState, proposed: Float[Array, ""]) -> IntegrationState:
        """The step is tried again from its start, with another size; without a start, there is no motion."""
        hopeless = (state.stage == 0) | (proposed < ROUND_OFF * self.interval.span)
        return self.with_step(
            state._replace(
                proposed=proposed,
                stage=jnp.ones_like(state.stage),
                newton=begin_newton(state.slopes[0, 1]),
                rejected=state.rejected + 1,
                failed=state.failed | hopeless,
            )
        )

    def remembering(
        self, state: IntegrationState, here: Linearization, loads: Float[Array, " channels"]
    ) -> IntegrationState:
        """What terms remember if a step ends here, and what they have lost on the way."""
        before = self.robot.with_memories(state.memories)
        after = self.robot.with_memories(before.remember(here.motion, loads))
        lost = state.energies.dissipated + after.dissipated() - before.dissipated()
        return state._replace(memories=after.memories, energies=state.energies._replace(dissipated=lost))

    def with_energies(
        self, state: IntegrationState, found: NewtonStep, here: Linearization
    ) -> IntegrationState:
        """The energies, and the time until a contact closes, at a point that is just reached."""
        contact = [term.max_step_fraction(self.robot, here.motion, found.v) for term in self.robot.terms]
        return state._replace(
            energies=state.energies._replace(kinetic=here.kinetic_energy(found.v), potential=found.potential),
            contact=jnp.min(jnp.stack([jnp.array(jnp.inf), *contact])),
        )

    def with_step(self, state: IntegrationState) -> IntegrationState:
        """The step that is proposed, fitted into the interval."""
        left = self.interval.end - state.time
        return state._replace(step=fitted_step(left, state.proposed, state.contact))


def _with_stage(state: IntegrationState, found: NewtonStep, here: Linearization) -> IntegrationState:
    """The stage's slope and force are kept, and the next stage is begun."""
    own = jnp.arange(TABLEAU.stages) == state.stage  # a scatter is slower on the CPU
    return state._replace(
        slopes=jnp.where(own[:, None, None], jnp.stack([found.v, found.a]), state.slopes),
        forces=jnp.where(own[:, None], here.potential.load_energy, state.forces),
        dissipation=jnp.where(own, found.dissipation, state.dissipation),
        stage=state.stage + 1,
    )


def _first_case(
    *cases: tuple[Bool[Array, ""], IntegrationState], otherwise: IntegrationState
) -> IntegrationState:
    """The state of the first case that holds."""
    chosen = otherwise
    for holds, state in reversed(cases):
        chosen = jax.tree.map(lambda new, old, holds=holds: jnp.where(holds, new, old), state, chosen)
    return chosen
