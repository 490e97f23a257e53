"""Motion in time against closed forms, conservation laws, other integrators, and SoRoSim."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.special import ellipk

from exosight import lie
from exosight.errors import InputError
from exosight.mechanics import (
    Circular,
    DeadForce,
    Fixed,
    Free,
    Gauss,
    Gravity,
    Legendre,
    Link,
    Motion,
    MotionOptions,
    Prismatic,
    Revolute,
    Robot,
    Rod,
    SolverOptions,
    SphereContact,
    Term,
    drive,
    evolve,
    walk,
)
from exosight.mechanics.contact import Spheres
from exosight.mechanics.term import Bound, Expansion, zero
from exosight.mechanics.timestep import spatial_inertia
from exosight.mechanics.tree import Tree

G = 9.81
DOWN = Gravity(jnp.array([0.0, 0.0, -G]))
FINE = MotionOptions(tolerance=1e-9)


def fixed(step: float, tolerance: float = 1e-11) -> MotionOptions:
    return MotionOptions(tolerance=tolerance, step=step)


def pendulum(length: float = 1.0, gravity: float = G, **springs: float) -> Robot:
    """A point mass of 1 kg on a hinge about y; q = 0 is level, π/2 hanging."""
    bob = Link("bob", length, np.array([[length, 0.0, 0.0]]), mass=np.ones(1), joint=Revolute(**springs))
    return Robot((bob,), (Gravity(jnp.array([0.0, 0.0, -gravity])),))


def double_pendulum() -> Robot:
    """Two point masses of 1 kg on two links of 1 m, and a level force on the last."""
    first = Link("first", 1.0, np.array([[1.0, 0.0, 0.0]]), mass=np.ones(1), joint=Revolute())
    second = Link(
        "second", 1.0, np.array([[1.0, 0.0, 0.0]]), mass=np.ones(1), joint=Revolute(), parent="first"
    )
    return Robot((first, second), (DOWN, DeadForce("second", 0, 0, jnp.array([1.0, 0.0, 0.0]))))


def body() -> Robot:
    """A free rigid body of 2 kg with three different moments of inertia."""
    inertia = np.diag([0.01, 0.02, 0.025])[None]
    return Robot(
        (Link("body", 0.0, np.zeros((1, 3)), mass=np.array([2.0]), inertia=inertia, joint=Free()),), (DOWN,)
    )


def ball(height: float, stiffness: float) -> Robot:
    """A ball of 0.1 kg and 1 cm on a vertical slide, its lowest point so high above a sphere of 1 cm."""
    slide = Prismatic((0.0, 0.0, 1.0))
    up = lie.translation(jnp.array([0.0, 0.0, 0.02 + height]))
    falling = Link("ball", 0.0, np.zeros((1, 3)), mass=np.array([0.1]), joint=slide, mount=up)
    ground = Link("ground", 0.0, np.zeros((1, 3)), joint=Fixed())
    spheres = [Spheres(((name, 0),), jnp.array([0.01])) for name in ("ball", "ground")]
    return Robot((falling, ground), (DOWN, SphereContact(*spheres, jnp.array(stiffness))))


def cantilever(
    radius: float = 0.01, density: float = 1000.0, viscosity: float = 3e4, gravity: float = G
) -> Robot:
    """The clamped rod of SoRoSim's released cantilever, with other numbers if wanted."""
    points = Gauss(1, 6)
    rod = Rod(
        "rod",
        0.3,
        Circular(np.full(points.size, radius)),
        young=1e6,
        density=density,
        viscosity=viscosity,
        strains={"bend_y": Legendre(5), "stretch_x": Legendre(5)},
        quadrature=points,
    )
    return Robot((rod,), (Gravity(jnp.array([0.0, 0.0, -gravity])),))


def test_free_fall_is_a_parabola() -> None:
    """Straight and at constant acceleration: a polynomial that the method integrates to round-off."""
    time = np.linspace(0.0, 1.0, 3)
    start = np.array([0.0, 0.0, 0.0, 1.0, -2.0, 3.0])
    found = evolve([body()], time, velocity=start[None])
    expected = time[:, None] * start + 0.5 * time[:, None] ** 2 * [0, 0, 0, 0, 0, -G]
    np.testing.assert_allclose(found.q[0], expected, atol=1e-12)
    np.testing.assert_allclose(found.kinetic + found.potential, found.kinetic[0, 0], rtol=1e-12)


def momentum(robot: Robot, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    motion = walk(robot, jnp.asarray(q))
    inertia = spatial_inertia(robot)(motion.pose)
    return np.asarray(jnp.einsum("fij,fjq,q->i", inertia, motion.jacobian, v))


def test_a_spinning_body_keeps_its_momentum_and_energy() -> None:
    """About its middle axis, which is unstable, weightless: both errors fall at fourth order or faster."""
    robot = eqx.tree_at(lambda robot: robot.terms[0].acceleration, body(), jnp.zeros(3))
    start = np.array([0.3, 3.0, 0.2, 0.1, 0.0, 0.0])
    lost = []
    for step in (0.05, 0.025):
        found = evolve([robot], np.array([0.0, 1.0]), velocity=start[None], options=fixed(step))
        assert np.linalg.norm(found.q[0, -1, :3]) < 2 * np.pi  # where the rotation vector is singular
        before, after = (momentum(robot, found.q[0, k], found.velocity[0, k]) for k in (0, 1))
        np.testing.assert_allclose(before, inertia_times(start), atol=1e-15)
        lost.append([np.linalg.norm(after - before), abs(found.kinetic[0, 1] - found.kinetic[0, 0])])
    assert np.all(np.log2(lost[0]) - np.log2(lost[1]) > 3.7)
    assert np.all(np.array(lost[1]) < 1e-5)


def inertia_times(twist: np.ndarray) -> np.ndarray:
    return np.array([0.01, 0.02, 0.025, 2.0, 2.0, 2.0]) * twist


def quarter_period(length: float) -> float:
    """Of a pendulum released level (90°): K(1/2) √(L/g)."""
    return ellipk(0.5) * np.sqrt(length / G)


def test_pendulum_period_is_the_elliptic_integral() -> None:
    """After five quarter periods it hangs, at its highest speed."""
    time = np.array([0.0, 1.0, 5.0]) * quarter_period(0.7)
    found = evolve([pendulum(0.7)], time, options=FINE)
    # Some 300 steps of 1e-9 m each, if all were to add up, at 0.7 m.
    np.testing.assert_allclose(found.q[0, 1:, 0], np.pi / 2, atol=5e-7)
    np.testing.assert_allclose(found.velocity[0, 1:, 0], np.sqrt(2 * G / 0.7) * np.array([1, 1]), rtol=5e-7)


def test_error_falls_at_fourth_order() -> None:
    time = np.array([0.0, 5 * quarter_period(1.0)])
    errors = [
        abs(evolve([pendulum()], time, options=fixed(time[1] / n)).q[0, -1, 0] - np.pi / 2)
        for n in (40, 80, 160)
    ]
    np.testing.assert_allclose(np.diff(np.log2(errors)), -4, atol=0.25)


def test_damped_oscillator_decays_as_it_should() -> None:
    """1 kg m², 40 N m/rad, 2 N m s/rad without weight: e^(−t) (cos ωt + sin ωt / ω), ω² = 39."""
    time = np.linspace(0.0, 3.0, 7)
    found = evolve(
        [pendulum(gravity=0.0, stiffness=40.0, damping=2.0)], time, q=np.array([[0.5]]), options=FINE
    )
    w = np.sqrt(39)
    expected = 0.5 * np.exp(-time) * (np.cos(w * time) + np.sin(w * time) / w)
    np.testing.assert_allclose(found.q[0, :, 0], expected, atol=5e-8)
    total = found.kinetic + found.potential + found.dissipated
    np.testing.assert_allclose(total, 0.5 * 40 * 0.5**2, rtol=1e-6)


@pytest.mark.parametrize("angle", [0.2, 0.4])
def test_one_step_shifts_and_damps_a_vibration_as_stated(angle: float) -> None:
    """(ωh)⁶/18000 of its energy and (ωh)⁵/1200 of its phase, to leading order: ωh of 0.4 adds a tenth."""
    frequency = 3.0
    robot = pendulum(gravity=0.0, stiffness=frequency**2)
    step = angle / frequency
    found = evolve([robot], np.array([0.0, step]), q=np.array([[0.3]]), options=fixed(step, 1e-13))
    energy = (found.kinetic + found.potential)[0]
    assert 1 - energy[1] / energy[0] == pytest.approx(angle**6 / 18000, rel=0.1)
    phase = np.arctan2(-found.velocity[0, 1, 0] / frequency, found.q[0, 1, 0])
    assert abs(phase - angle) == pytest.approx(angle**5 / 1200, rel=0.02)


def first_mode(robot: Robot, evaluate: Callable) -> tuple[float, np.ndarray]:
    """Frequency [rad/s] and shape of the slowest vibration, so small that the rod stays linear."""
    here, still = evaluate(robot, np.zeros(robot.dofs), np.zeros(0))
    inertia = spatial_inertia(robot)(still.pose)
    mass = np.einsum("fip,fij,fjq->pq", still.jacobian, inertia, still.jacobian)
    squares, modes = eigh(here.hessian, mass)
    return np.sqrt(squares[0]), 1e-3 * modes[:, 0] / np.abs(modes[:, 0]).max()


def test_first_bending_frequency_is_euler_bernoullis(evaluate: Callable) -> None:
    """A thin rod without weight: ω = 1.8751² √(EI/ρA)/L², and the motion in that mode is a cosine."""
    robot = cantilever(radius=3e-4, viscosity=0.0, gravity=0.0)
    frequency, start = first_mode(robot, evaluate)
    exact = 1.8751040687**2 * np.sqrt(1e6 * (3e-4) ** 2 / 4 / 1000) / 0.3**2
    # Six Gauss points integrate polynomials of degree 11; the square of this mode is one of degree 14.
    assert frequency == pytest.approx(exact, rel=5e-5)

    time = np.linspace(0.0, 2.0, 9) * np.pi / frequency
    found = evolve([robot], time, q=start[None], options=MotionOptions(tolerance=1e-10))
    # A thousand steps of up to 1e-10 m on 0.3 m.
    np.testing.assert_allclose(found.q[0], np.cos(frequency * time)[:, None] * start, atol=3e-8)


@pytest.mark.parametrize("ratio", [0.02, 0.3])
def test_vibration_of_a_viscous_rod_decays_by_the_decrement(evaluate: Callable, ratio: float) -> None:
    """Kelvin–Voigt: ζ = ω τ/2 with τ viscosity over Young's modulus, and 2πζ/√(1 − ζ²) a cycle."""
    robot = cantilever(radius=3e-4, viscosity=0.0, gravity=0.0)
    frequency, mode = first_mode(robot, evaluate)
    robot = cantilever(radius=3e-4, viscosity=1e6 * 2 * ratio / frequency, gravity=0.0)
    slowed = np.sqrt(1 - ratio**2)
    cycles = np.arange(5)
    time = cycles * 2 * np.pi / (frequency * slowed)
    found = evolve([robot], time, q=mode[None], options=MotionOptions(tolerance=1e-11))
    decrement = 2 * np.pi * ratio / slowed
    # 160 steps of up to 1e-11 m on 0.3 m, and a rod that is linear to (1e-3)² of 1e-3.
    np.testing.assert_allclose(found.q[0], np.exp(-decrement * cycles)[:, None] * mode, atol=3e-9)
    # Energies are squares: of 1e-3, whose errors are 2e-9.
    total = found.kinetic + found.potential + found.dissipated
    np.testing.assert_allclose(total, total[0, 0], rtol=1e-5)


def test_error_of_a_viscous_rod_falls_at_fourth_order() -> None:
    """Stiff and damped, where many methods of high order lose some of it."""
    time = np.array([0.0, 0.2])
    exact = evolve([cantilever()], time, options=MotionOptions(tolerance=1e-12)).q[0, -1]
    errors = [
        np.linalg.norm(evolve([cantilever()], time, options=fixed(0.2 / n)).q[0, -1] - exact)
        for n in (8, 16, 32, 64)
    ]
    assert np.all(np.diff(np.log2(errors)) < -3.5)


@pytest.mark.parametrize(("options", "most"), [(MotionOptions(), 4e-6), (FINE, 3e-7), (fixed(0.01), 3e-6)])
def test_released_cantilever_of_sorosim(
    reference: Callable, motion: Callable, options: MotionOptions, most: float
) -> None:
    """Case 6: a second of fall and swing under weight, computed at a tolerance of 1e-6 there.

    Its viscosity is that of shear, a third of the extensional one of an incompressible rod.
    """
    of = reference("sorosim_dynamics")
    robot = cantilever(of["radius"], float(of["density"]), 3.0 * of["shear_viscosity"])
    rod = robot.bodies[0]
    assert isinstance(rod, Rod)
    np.testing.assert_allclose(rod.quadrature.points, of["points"], atol=1e-15)
    assert (float(rod.length), float(rod.young), of["gravity"]) == (of["length"], of["young"], [0, 0, -G])
    found = evolve([robot], np.array(of["time"]), options=options)
    assert found.converged.all()
    tip = np.array([motion(robot, q).position[-1] for q in found.q[0]])
    np.testing.assert_allclose(tip, of["tip"], atol=most)
    total = found.kinetic + found.potential + found.dissipated
    np.testing.assert_allclose(total, total[0, 0], atol=most)


def test_rest_of_a_damped_motion_is_the_equilibrium() -> None:
    robot = cantilever(viscosity=3e5)
    still = drive([robot], np.zeros((1, 0)), options=SolverOptions())
    found = evolve([robot], np.array([0.0, 10.0]))
    assert found.converged.all()
    assert found.steps[0, -1] < 200  # the steps grow as it comes to rest
    # The slowest mode decays as e^(−5 t); what is left is from the tolerance of the last long steps.
    np.testing.assert_allclose(found.q[0, -1], still.q[0, 0], atol=1e-6)
    np.testing.assert_allclose(found.kinetic[0, -1], 0, atol=1e-12)


def test_a_ball_bounces_for_as_long_and_as_high_as_it_should() -> None:
    """Fall, contact of a linear spring under weight, rise: the cycle's length is known in closed form."""
    height, stiffness, mass = 0.05, 5e3, 0.1
    speed, w = np.sqrt(2 * G * height), np.sqrt(stiffness / mass)
    cycle = 2 * speed / G + 2 / w * (np.pi - np.arctan(speed * w / G))
    time = np.concatenate([np.arange(4) * cycle, [3.1 * cycle]])
    found = evolve([ball(height, stiffness)], time, options=MotionOptions(tolerance=1e-9))
    assert found.converged.all()
    # Every kink costs some errors of one step over its length, 1e-9 m / 1 ms; flight carries them on.
    np.testing.assert_allclose(found.q[0, :4, 0], 0.0, atol=3e-5)
    np.testing.assert_allclose(found.q[0, 4, 0], -0.5 * G * (0.1 * cycle) ** 2, atol=3e-5)
    total = found.kinetic + found.potential
    np.testing.assert_allclose(total, total[0, 0], rtol=5e-4)


class Cliff(Term):
    """An energy height (place − q)^1.5, no number beyond its place."""

    height: jax.Array
    place: jax.Array

    def bind(self, tree: Tree) -> Bound:
        def expand(q: jax.Array, motion: Motion, loads: jax.Array) -> Expansion:
            left = self.place - q
            force = -1.5 * self.height * jnp.sqrt(left)
            return zero(tree, loads)._replace(energy=self.height * jnp.sum(left**1.5), gradient=force)

        return expand


def by_a_cliff(length: float, height: float, place: float) -> Robot:
    robot = pendulum(length)
    return Robot(robot.bodies, (*robot.terms, Cliff(jnp.array(height), jnp.array(place))))


def test_many_robots_move_as_each_alone_and_those_that_fail_do_not_stop_them() -> None:
    lengths = (0.05, 0.5, 0.7)
    robots = [by_a_cliff(length, 0.0, 10.0) for length in lengths]
    time = np.linspace(0.0, 2.0, 3)
    finished = []
    together = evolve(robots, time, done=finished.append, options=MotionOptions(lanes=2))
    assert sum(finished) == 3
    for i, length in enumerate(lengths):
        alone = evolve([pendulum(length)], time)
        np.testing.assert_allclose(together.q[i], alone.q[0], atol=1e-12)
        assert together.steps[i, -1] == alone.steps[0, -1]
    # The fastest needs the most steps.
    enough = int(np.diff(together.steps + together.rejected, axis=1)[1:].max()) + 1
    limited = evolve(robots, time, options=MotionOptions(max_steps=enough, lanes=2))
    assert limited.converged.tolist() == [[True, False, False], [True] * 3, [True] * 3]
    np.testing.assert_allclose(limited.q[1:], together.q[1:], atol=1e-12)
    # One that comes to where its energy is no number stays there, and says so.
    robots[1] = by_a_cliff(0.5, 1.0, 1.0)
    found = evolve(robots, time, options=MotionOptions(lanes=2))
    assert found.converged.tolist() == [[True] * 3, [True, False, False], [True] * 3]
    np.testing.assert_allclose(found.q[1, 1:, 0], 1.0, atol=1e-6)
    assert all(np.all(np.isfinite(values)) for values in (found.velocity, found.kinetic, found.potential))
    np.testing.assert_allclose(found.q[::2], together.q[::2], atol=1e-12)


def test_bad_input_is_named() -> None:
    time = np.array([0.0, 1.0])
    one = [double_pendulum()]
    for message, call in (
        ("at least one", lambda: evolve([], time)),
        ("one structure", lambda: evolve([*one, pendulum()], time)),
        (
            "no coordinates",
            lambda: evolve([Robot((Link("a", 0.1, np.zeros((1, 3)), mass=np.ones(1)),))], time),
        ),
        ("ascending", lambda: evolve(one, time[::-1])),
        ("ascending", lambda: evolve(one, np.array([0.0, np.nan]))),
        ("at least two", lambda: evolve(one, time[:1])),
        ("need 1 channels, got 0", lambda: evolve(one, time)),
        ("one row for each of 2 times", lambda: evolve(one, time, np.zeros((3, 1)))),
        ("loads: expected finite", lambda: evolve(one, time, np.full((2, 1), np.inf))),
        ("q: expected finite", lambda: evolve(one, time, np.zeros((2, 1)), q=np.array([[0.0, np.nan]]))),
        (
            r"q: expected .* \(1, 2\), got \(1, 3\)",
            lambda: evolve(one, time, np.zeros((2, 1)), q=np.ones((1, 3))),
        ),
        (
            r"velocity: expected .* \(1, 2\)",
            lambda: evolve(one, time, np.zeros((2, 1)), velocity=np.ones((1, 3))),
        ),
        ("moves no mass", lambda: evolve([pendulum(1.0), pendulum(0.0)], time)),
        ("moves no mass", lambda: evolve([cantilever(density=0.0)], time)),
        ("above 0", lambda: MotionOptions(tolerance=0.0)),
    ):
        with pytest.raises(InputError, match=message):
            call()
